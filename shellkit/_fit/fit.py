"""The training loop: it runs on the host, around a step that is compiled once, kept on disk and shown."""

import os
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import optimistix as optx
from jaxtyping import PyTree

from . import checkpoint as _checkpoint
from .checkpoint import Checkpoint
from .choices import Refuse, WarmStart, check_count
from .design import Bounds, split
from .history import FitResult, FitStep, History
from .loop import Loop, Trainable
from .methods.base import Method
from .methods.from_optimistix import from_optimistix
from .methods.gradient import GradientMethod
from .observers import Bar, Observer
from .retired import takes_retired


if TYPE_CHECKING:
    import optax


@takes_retired
def fit(
    problem: Trainable,
    method: "optax.GradientTransformation | Method | optx.AbstractLeastSquaresSolver",
    *,
    steps: int,
    where: Callable[[Any], PyTree] | None = None,
    bounds: Sequence[Bounds] = (),
    warm_start: WarmStart | None = None,
    refuse: Refuse = Refuse(),
    checkpoint: str | os.PathLike | Checkpoint | None = None,
    callbacks: Sequence[Callable[[FitStep], object] | Observer] = (),
    progress: bool = True,
) -> FitResult:
    r"""Trains arrays of a problem: minimises its loss with an optax optimiser, by least squares, or with a method of
    your own.

    Each step relaxes the shell, evaluates the loss and its gradient, records them in the history, and lets the method
    update the design. The step is compiled once; fitting the same kind of problem again with other values, and the same
    `method` object, compiles nothing. After the last update the design is evaluated once more, without a row in the
    history, as it may be the best one.

    **Refused designs.** A design whose loss or gradient is not finite, or whose relaxation does not converge, is
    refused: the method never sees it. The loop returns to the last good design and takes half of the update, half of
    that again, and so on; the scale doubles back to one with each design accepted afterwards. The first refusal of a
    fit warns; the history counts them (`refused`, `update_scale`). [`shellkit.Refuse`][] says what else is refused.

    **Second-order training** with [`shellkit.LevenbergMarquardt`][], [`shellkit.GaussNewton`][] or
    [`shellkit.Dogleg`][] wants a loss that is a sum of squares ([`shellkit.LeastSquaresLoss`][] and sums of such with
    weights) and takes far fewer steps than descent. The solvers of optimistix of these names stand for them, with their
    tolerances and norm; of their linear solver `lineax.Normal(lineax.CG(rtol, atol, max_steps=…))` sets `accuracy` and
    `products`, and another one than they have by default asks for the whole Jacobian. A warning names whatever else was
    set in them, as it is not used.

    **Arguments:**

    - `problem`: the [`shellkit.InverseProblem`][] to train, with a loss. Any pytree will do whose
        `objective(start=None)` returns `(loss, ({term: value}, equilibrium or None))`, such as a sum over several
        problems.
    - `method`: any optax optimiser, schedules included; also those that search along a line (`optax.lbfgs()`), which
        relax several times per step; or a [`shellkit.Method`][]. It sees the design as a dictionary of arrays by name,
        such as `"actuation.top.angle"`, which `optax.multi_transform` can label.
    - `steps`: the number of steps in all, those of a resumed checkpoint included.
    - `where`: a function from the problem to the array or arrays (a tuple, or any pytree) to train, as in
        `lambda p: p.actuation.angle`. `None`: all floating-point arrays of `problem.actuation`. The others are not
        differentiated.
    - `bounds`: [`shellkit.Bounds`][] on trained arrays.
    - `warm_start`: a [`shellkit.WarmStart`][], to start relaxations from the last equilibrium. `None`: from rest.
    - `refuse`: a [`shellkit.Refuse`][]: which designs are refused, and how many in a row.
    - `checkpoint`: the path of a file to keep the fit in, or a [`shellkit.Checkpoint`][], which says how often as well.
        If the file exists, the fit is taken up from there, and goes on exactly as it would have without the stop.
    - `callbacks`: functions called with a [`shellkit.FitStep`][] at each step, before its update; one that returns
        `True` ends the fit. And what is told of each step after its update: [`shellkit.Stop`][],
        [`shellkit.JsonLines`][], [`shellkit.TensorBoard`][].
    - `progress`: whether to show a bar on a terminal or in a notebook. Elsewhere nothing is shown.

    **Returns:** a [`shellkit.FitResult`][] with the best problem, its loss, the history and why the fit stopped. Ctrl-C
    ends the fit and returns what there is.

    **Raises:** `ValueError` if `where` picks something that is no floating-point array, if the very first design is
    not acceptable, if the checkpoint belongs to another fit (the message says what differs; hyperparameters of the
    method are not compared), if a file at its path is something else, or if an option is out of range.

    ??? example

        ```python
        result = sk.fit(problem, optax.adam(0.1), steps=200, where=lambda p: p.actuation.angle, checkpoint="run")
        result.problem()  # the equilibrium of the best design
        ```

    When not to use it: for a loop of your own, `problem.evaluate()` differentiates like any function.
    """
    if not isinstance(problem, Trainable):
        raise ValueError(f"fit trains an InverseProblem, or what has its method objective(); got {type(problem)}.")
    check_count("steps", steps)
    design, values = split(problem, where, bounds)
    loop = Loop(design, as_method(method, stacklevel=5), refuse, warm_start)
    run, history = loop.begin(values), History()
    kept = checkpoint if checkpoint is None or isinstance(checkpoint, Checkpoint) else Checkpoint(checkpoint)
    path = None if kept is None else _checkpoint.prepare(kept.path)
    identity = {} if path is None else loop.identity(values, run.course.state)
    if path is not None and path.exists():
        run, history = loop.resume(_checkpoint.read(path), identity, run)
    if run.step >= steps:
        return loop.result(run, history, "steps")

    loop.compile_ahead(run)
    functions = [callback for callback in callbacks if not isinstance(callback, Observer)]
    observers = [Bar()] if progress else []
    observers += [callback for callback in callbacks if isinstance(callback, Observer)]
    stopped, earlier, began = "running", run.seconds, time.perf_counter()
    try:
        with ExitStack() as stack:
            told = [stack.enter_context(observer.opened(steps, run.step)) for observer in observers]
            while stopped == "running":
                tried = loop.next_design(run, history)
                if isinstance(tried, str):
                    stopped = tried
                    break
                history.append(loop.row(run, tried, history, earlier + time.perf_counter() - began))
                # Nobody is told anything that nobody asked for: putting a problem together takes its time.
                info: Any = loop.info(run, tried, steps, history) if functions or told else None
                answers = [bool(callback(info)) for callback in functions]
                run = loop.after(run, tried, history)
                reasons = [reason for tell in told if (reason := tell(info)) is not None]
                if any(answers):
                    stopped = "callback"
                elif run.step >= steps:
                    stopped = "steps"
                elif reasons:
                    stopped = reasons[0]
                elif kept is not None and path is not None and run.step % kept.every == 0:
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


def as_method(method: Any, stacklevel: int) -> Method:
    """The method that an optimiser of optax or optimistix stands for, or one of ours as it is."""
    import optax

    if isinstance(method, Method):
        return method
    if isinstance(method, optax.GradientTransformation):
        return GradientMethod(method)
    if isinstance(method, optx.AbstractLeastSquaresSolver):
        return from_optimistix(method, stacklevel)
    raise ValueError(
        "method must be an optimiser of optax, such as optax.adam(0.1), a method of this package, such as "
        "shellkit.LevenbergMarquardt(), one of your own (shellkit.Method), or a least-squares solver of optimistix; "
        f"got {method!r}."
    )
