"""The training loop: it runs on the host, around a step that is compiled once, kept on disk and shown."""

import os
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import optimistix as optx
from jaxtyping import PyTree

from . import checkpoint as _checkpoint
from .design import Bounds, split
from .history import FitResult, FitStep, History
from .loop import Loop, Trainable
from .methods.base import GradientMethod, Method
from .methods.least_squares import SquaresMethod, SquaresTrainable
from .progress import Bar, JsonLines, Reporter, TensorBoard


if TYPE_CHECKING:
    import optax


def fit(
    problem: Trainable,
    optimiser: "optax.GradientTransformation | optx.AbstractLeastSquaresSolver",
    *,
    steps: int,
    where: Callable[[Any], PyTree] | None = None,
    bounds: Sequence[Bounds] = (),
    checkpoint: str | os.PathLike | None = None,
    checkpoint_every: int = 25,
    progress: bool = True,
    log: str | os.PathLike | None = None,
    tensorboard: str | os.PathLike | None = None,
    callbacks: Sequence[Callable[[FitStep], object]] = (),
    patience: int | None = None,
    tolerance: float = 1e-4,
    max_seconds: float | None = None,
    max_refusals: int = 8,
    max_rise: float | None = None,
    unconverged: Literal["refuse", "accept"] = "refuse",
    warm_start: Literal["rest", "last", "predicted"] = "rest",
    check_every: int = 20,
) -> FitResult:
    r"""Trains arrays of a problem: minimises its loss with an optax optimiser or a least-squares solver of optimistix.

    Each step relaxes the shell, evaluates the loss and its gradient, records them in the history, and lets the
    optimiser update the design. The step is compiled once; fitting the same kind of problem again with other values,
    and the same `optimiser` object, compiles nothing. After the last update the design is evaluated once more, without
    a row in the history, as it may be the best one.

    **Refused designs.** A design whose loss or gradient is not finite, or whose relaxation does not converge, is
    refused: the optimiser never sees it. The loop returns to the last good design and takes half of the update, half of
    that again, and so on; the scale doubles back to one with each design accepted afterwards. The first refusal of a
    fit warns; the history counts them (`refused`, `update_scale`). With `max_rise`, so is a design at which the loss
    leaps up, as where the shell snaps: with a warm start a shorter step from the last equilibrium stays on its branch.

    **Second-order training** with `optimistix.LevenbergMarquardt`, `GaussNewton` or `Dogleg` wants a loss that is a sum
    of squares ([`shellkit.LeastSquaresLoss`][] and sums of such with weights) and takes far fewer steps than descent.
    At each accepted design the Hessian is factorised once, and the Jacobian of the residuals is looked at by products,
    a sweep with that factor each: in full where it is small, else on the Krylov space of its first 100 pairs of
    products or fewer. A trial design that raises the loss, or is refused, costs its relaxation and nothing more. Of the
    solver count its kind, its tolerances and norm (the fit stops as `"converged"` when the next step is below them) and
    its linear solver: `lineax.Normal(lineax.CG(rtol, atol, max_steps=…))` sets how well and by how many products the
    Krylov space is made, `lineax.SVD()` asks for the whole Jacobian. Damping and radius follow rules of this package,
    as every trial is a relaxation; the history has them as `control`.

    **Warm starts** save relaxation steps, and can mislead: a shell with several equilibria follows the one it is on,
    which is not always the one that it would relax to from rest. Hence every `check_every` steps the design is relaxed
    from rest as well; `warm_gap` in the history records by how much the losses differ, and the fit warns when they
    part. The best design is checked at the end.

    **Arguments:**

    - `problem`: the [`shellkit.InverseProblem`][] to train, with a loss. Any pytree will do whose
        `objective(start=None)` returns `(loss, ({term: value}, equilibrium or None))`, such as a sum over several
        problems.
    - `optimiser`: any optax optimiser, schedules included; also those that search along a line (`optax.lbfgs()`), which
        relax several times a step; or a least-squares solver of optimistix. It sees the design as a dictionary of
        arrays by name, such as `"actuation.top.angle"`, which `optax.multi_transform` can label.
    - `steps`: the number of steps in all, those of a resumed checkpoint included.
    - `where`: a function from the problem to the array or arrays (a tuple, or any pytree) to train, as in
        `lambda p: p.actuation.angle`. `None`: all floating-point arrays of `problem.actuation`. The others are not
        differentiated.
    - `bounds`: [`shellkit.Bounds`][] on trained arrays.
    - `checkpoint`: the path of a file to keep the fit in. If it exists, the fit is taken up from there, and goes on
        exactly as it would have without the stop. It is replaced atomically, so a kill at any moment does no harm.
        A file that is no checkpoint is never touched.
    - `checkpoint_every`: how many steps apart it is written; it is also written when the fit ends, were it by an error.
    - `progress`: whether to show a bar on a terminal or in a notebook. Elsewhere nothing is shown.
    - `log`: the path of a file to append each row of the history to, as a line of JSON. When a killed fit is resumed,
        the steps since its checkpoint come a second time.
    - `tensorboard`: a folder to write curves to; needs the extra `tensorboard`.
    - `callbacks`: functions called with a [`shellkit.FitStep`][] at each step. One that returns `True` stops it.
    - `patience`: stop when the best loss of the last `patience` steps is not below the best before them by the fraction
        `tolerance`. `None`: never.
    - `tolerance`: that fraction.
    - `max_seconds`: stop after the step during which this time is over, counted for this call.
    - `max_refusals`: how many designs in a row to refuse before the fit stops.
    - `max_rise`: turn a design down if its loss is above that of the step before by more than this fraction of it, at
        most four in a row: the one after these is taken. Nor is a warm start that fails tried again from rest before
        that. `None`: never. A least-squares solver goes downhill unless this lets it climb, over the edge of a snap,
        say; it takes no other design, however many are turned down.
    - `unconverged`: `"accept"` designs whose relaxation did not converge, where a minimiser stops short of its
        tolerance as a rule; their gradients are only about right.
    - `warm_start`: start each relaxation from `"rest"`, from the `"last"` equilibrium, or from its first-order
        prediction (`"predicted"`: one more linear solve a step).
    - `check_every`: how many steps apart a warm start is checked against a relaxation from rest.

    **Returns:** a [`shellkit.FitResult`][] with the best problem, its loss, the history and why the fit stopped. Ctrl-C
    ends the fit and returns what there is.

    **Raises:** `ValueError` if `where` picks something that is no floating-point array, if the very first design is
    not acceptable, if the checkpoint belongs to another fit (the message says what differs; the optimiser's
    hyperparameters are not compared), if a file at its path is something else, or if an option is out of range.

    ??? example

        ```python
        result = sk.fit(problem, optax.adam(0.1), steps=200, where=lambda p: p.actuation.angle, checkpoint="run")
        result.problem()  # the equilibrium of the best design
        ```

    When not to use it: for a loop of your own, `problem.evaluate()` differentiates like any function.
    """
    _check(problem, unconverged, warm_start, tolerance, max_seconds, max_rise)
    _check_count("steps", steps)
    _check_count("checkpoint_every", checkpoint_every)
    _check_count("check_every", check_every)
    _check_count("patience", 1 if patience is None else patience)
    _check_count("max_refusals", max_refusals, least=0)
    design, values = split(problem, where, bounds)
    method = _method(problem, optimiser, max_rise)
    loop = Loop(design, method, unconverged == "refuse", warm_start, check_every, max_refusals, max_rise)
    run, history = loop.begin(values), History()
    path = None if checkpoint is None else _checkpoint.prepare(checkpoint)
    identity = {} if path is None else loop.identity(values, run.course.state)
    if path is not None and path.exists():
        run, history = loop.resume(_checkpoint.read(path), identity, run)
    if run.step >= steps:
        return loop.result(run, history, "steps")

    reporters: list[Reporter] = [Bar(steps, run.step)] if progress else []
    reporters += [] if log is None else [JsonLines(log)]
    reporters += [] if tensorboard is None else [TensorBoard(tensorboard)]
    stopped, earlier, began = "running", run.seconds, time.perf_counter()
    try:
        with ExitStack() as stack:
            for reporter in reporters:
                stack.enter_context(reporter)
            while stopped == "running":
                tried = loop.next_design(run, history)
                if isinstance(tried, str):
                    stopped = tried
                    break
                history.append(loop.row(run, tried, history, earlier + time.perf_counter() - began))
                info = loop.info(run, tried, steps, history)
                asked = [bool(callback(info)) for callback in callbacks]
                run = loop.after(run, tried, history)
                for reporter in reporters:
                    reporter(info)
                if any(asked):
                    stopped = "callback"
                elif run.step >= steps:
                    stopped = "steps"
                elif patience is not None and _on_plateau(history["loss"], patience, tolerance):
                    stopped = "plateau"
                elif max_seconds is not None and time.perf_counter() - began > max_seconds:
                    stopped = "seconds"
                elif path is not None and run.step % checkpoint_every == 0:
                    _checkpoint.write(path, *loop.stored(run, history, identity, stopped))
            if stopped != "refused":
                run = loop.finish(run, history)
    except KeyboardInterrupt:
        stopped = "interrupted"
    finally:
        # An interrupt or an error may have come between a row and the update after it.
        history.truncate(run.step)
        if path is not None and run.step > 0:
            _checkpoint.write(path, *loop.stored(run, history, identity, stopped))
    return loop.result(run, history, stopped)


def _on_plateau(loss: np.ndarray, patience: int, tolerance: float) -> bool:
    if len(loss) <= patience:
        return False
    before, lately = loss[:-patience].min(), loss[-patience:].min()
    return bool(lately >= before - tolerance * abs(before))


def _method(problem: Any, optimiser: Any, max_rise: float | None) -> Method:
    import optax

    if isinstance(optimiser, optax.GradientTransformation):
        return GradientMethod(optimiser)
    if not isinstance(optimiser, optx.AbstractLeastSquaresSolver):
        raise ValueError(
            "optimiser must be one of optax's, such as optax.adam(0.1), or a least-squares solver of optimistix, such "
            f"as optimistix.LevenbergMarquardt(rtol=1e-6, atol=1e-9); got {optimiser!r}."
        )
    if not isinstance(problem, SquaresTrainable):
        raise ValueError(
            f"{type(optimiser).__name__} needs the residuals of the loss: give {type(problem).__name__} a method "
            "residuals(equilibrium), or train it with an optax optimiser."
        )
    return SquaresMethod(optimiser, max_rise)


def _check(
    problem: Any,
    unconverged: str,
    warm_start: str,
    tolerance: float,
    max_seconds: float | None,
    max_rise: float | None,
) -> None:
    if not isinstance(problem, Trainable):
        raise ValueError(f"fit trains an InverseProblem, or what has its method objective(); got {type(problem)}.")
    if unconverged not in ("refuse", "accept"):
        raise ValueError(f"unconverged must be 'refuse' or 'accept'; got {unconverged!r}.")
    if warm_start not in ("rest", "last", "predicted"):
        raise ValueError(f"warm_start must be 'rest', 'last' or 'predicted'; got {warm_start!r}.")
    if not tolerance >= 0:
        raise ValueError(f"tolerance must not be negative; got {tolerance}.")
    if max_rise is not None and not max_rise >= 0:
        raise ValueError(f"max_rise must not be negative, or be None; got {max_rise}.")
    if max_seconds is not None and not max_seconds > 0:
        raise ValueError(f"max_seconds must be positive, or None; got {max_seconds}.")


def _check_count(name: str, count: int, least: int = 1) -> None:
    if count != int(count) or count < least:
        raise ValueError(f"{name} must be a whole number, at least {least}; got {count}.")
