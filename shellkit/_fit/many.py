"""Many fits of one kind, from other starts or of other problems: one after another or together here, or by the workers
of any executor. Each can have a checkpoint of its own; one that fails does not take the others with it."""

import concurrent.futures as futures
import os
import pickle
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import jax
import numpy as np
from jaxtyping import PyTree

from . import checkpoint as _checkpoint
from .checkpoint import Checkpoint
from .design import Bounds, Named, selected, split
from .fit import as_method, fit
from .history import FitResult
from .methods.base import Method
from .retired import takes_retired
from .together import fit_together


_POLL = 0.05  # seconds between looks at jobs
_TOGETHER = ("steps", "where", "bounds", "refuse", "progress")  # options of fits side by side
_OVER = ("converged", "plateau", "callback", "refused")


@dataclass(frozen=True)
class ManyFits:
    """What [`shellkit.fit_many`][] returns.

    **Attributes:**

    - `results`: a [`shellkit.FitResult`][] for each start, in their order; `None` where it failed or was not reached.
    - `failures`: the exceptions of those that failed, by their number.
    """

    results: list[FitResult | None]
    failures: dict[int, BaseException]

    @property
    def losses(self) -> np.ndarray:
        """The best loss of each start, shape (n,); NaN where there is none."""
        return np.array([np.nan if result is None else result.best_loss for result in self.results])

    @property
    def best(self) -> FitResult:
        """The result with the smallest loss. A `ValueError` tells the first failure if there is no result."""
        there = [result for result in self.results if result is not None]
        if not there:
            first = next(iter(self.failures.values()), None)
            raise ValueError(f"no fit has a result; {len(self.failures)} failed, the first with: {first!r}")
        return min(there, key=lambda result: result.best_loss)

    def __repr__(self) -> str:
        done = sum(result is not None for result in self.results)
        best = f", best_loss={self.best.best_loss:.6g}" if done else ""
        return f"ManyFits({done} of {len(self.results)} done, {len(self.failures)} failed{best})"


@takes_retired
def fit_many(
    problems: Iterable[Any],
    method: Any,
    *,
    steps: int,
    make: Callable[[Any], Any] | None = None,
    where: Callable[[Any], PyTree] | None = None,
    bounds: Sequence[Bounds] = (),
    together: Literal["map", "vmap"] | None = None,
    executor: Any = None,
    folder: str | os.PathLike | Checkpoint | None = None,
    gathered: Callable[[int, FitResult | BaseException], object] | None = None,
    **options: Any,
) -> ManyFits:
    r"""Fits many problems, or one problem from many starts, and keeps what succeeds.

    Without an executor they are fitted one after another. All share one compiled step, so that the first start alone
    pays for compilation; on a CPU nothing in one process is much faster. With `together`, all starts advance step by
    step in one compiled call. `"map"` relaxes them in turn: as fast as one after another, with less to do between steps
    where a relaxation takes a millisecond or two. `"vmap"` evaluates them at once: for problems of your own that need
    no sparse solver; that of an [`shellkit.InverseProblem`][] cannot be batched, and in lockstep all would wait for the
    slowest. With an executor, each start is one job; its process compiles for itself, unless
    `JAX_COMPILATION_CACHE_DIR` is set.

    **Arguments:**

    - `problems`: the problems; or, with `make`, what they are made of, such as random keys.
    - `method`: as for [`shellkit.fit`][], or a function without arguments that makes it, such as
        `functools.partial(optax.adam, 0.1)`: optax's own cannot be sent to another process.
    - `steps`, `where`, `bounds`: as for `fit`; `where` and `bounds` name the same arrays in every problem.
    - `make`: called with each item of `problems`, where the fit runs; returns the problem. For other processes it must
        be a function at the top of an importable file, as must all that is sent to them.
    - `together`: `"map"` (by `jax.lax.map`) or `"vmap"`, for problems of one kind, with meshes of one size, and
        optimisers of optax, or methods of your own that JAX can trace and that take every design. Of the options it
        takes `refuse`, without a `rise`; it keeps no checkpoints, and a result comes when its last step is done.
    - `executor`: any `concurrent.futures.Executor` (local processes should be started by `"spawn"`, as JAX does not
        survive a fork), or one whose `submit` returns jobs with `done()` and `result()`, such as submitit's for a
        cluster. It is not shut down here.
    - `folder`: where each start keeps its checkpoint, `start-0000` and so on; or a [`shellkit.Checkpoint`][] with the
        folder for its path, which says how often as well. When the same call is made again, starts that ended are read
        and the others taken up where they stood.
    - `gathered`: called with the number of a start and its result, or the exception it failed with, as they come in.
    - `options`: further options of `fit`, but for `checkpoint`. No bar is shown unless asked for by `progress`.

    **Returns:** [`shellkit.ManyFits`][]. Results that come from another process, or were read from the folder, have no
    `equilibrium` and no `state`. Ctrl-C returns what there is.

    **Raises:** `ValueError` if there is no problem, if an option does not fit, or if something cannot be sent to other
    processes. What a single fit raises is kept in `failures`.

    ??? example

        ```python
        def start(key):
            angle = jax.random.uniform(key, (mesh.n_faces,), maxval=jnp.pi)
            return eqx.tree_at(lambda p: p.actuation.angle, problem, angle)


        many = sk.fit_many(jax.random.split(jax.random.key(0), 8), optax.adam(0.1), steps=100, make=start)
        many.best.problem
        ```
    """
    items = list(problems)
    if not items:
        raise ValueError("fit_many: there are no problems to fit.")
    if "checkpoint" in options:
        raise ValueError("fit_many: each start has a checkpoint of its own; give folder= in place of checkpoint=.")
    if together is not None:
        _check_together(together, method, executor, folder, options)
    first = items[0] if make is None else make(items[0])
    # Names travel between processes where functions such as lambdas do not.
    picked = where if where is None else Named(tuple(selected(first, where, "where")))
    limits = [replace(b, where=Named(tuple(selected(first, b.where, "Bounds.where")))) for b in bounds]
    options = {"progress": False, **options, "steps": steps, "where": picked, "bounds": limits}
    tasks = [_Task(item, make, method, _start(folder, number), options) for number, item in enumerate(items)]

    many = ManyFits([None] * len(items), {})

    def keep(number: int, outcome: Any) -> None:
        if isinstance(outcome, BaseException):
            many.failures[number] = outcome
        else:
            many.results[number] = outcome
        if gathered is not None:
            gathered(number, outcome)

    try:
        if together is not None:
            _side_by_side(tasks, together, keep)
        elif executor is None:
            for number, task in enumerate(tasks):
                outcome = _outcome(task.run)
                keep(number, outcome)
                if isinstance(outcome, FitResult) and outcome.stopped == "interrupted":
                    break
        else:
            _check_sendable(tasks[0], executor)
            for number, outcome in _from_workers(executor, tasks):
                keep(number, outcome)
    except KeyboardInterrupt:
        pass
    return many


@dataclass(frozen=True)
class _Task:
    """One fit, as it is sent to where it runs."""

    item: Any
    make: Callable[[Any], Any] | None
    method: Any
    checkpoint: Checkpoint | None
    options: dict[str, Any]

    def problem(self) -> Any:
        return self.item if self.make is None else self.make(self.item)

    def run(self) -> FitResult:
        problem = self.problem()
        if self.checkpoint is not None and Path(self.checkpoint.path).exists():
            header = _checkpoint.read(Path(self.checkpoint.path)).header
            if header["stopped"] in _OVER or header["step"] >= self.options["steps"]:
                return _checkpoint.load_checkpoint(self.checkpoint.path, problem)
        return fit(problem, _made(self.method), checkpoint=self.checkpoint, **self.options)

    def send(self) -> FitResult:
        """The result with only its trained arrays in place of problems: what can be sent back by any executor."""
        result = self.run()
        trained = lambda problem: jax.tree.map(np.asarray, split(problem, self.options["where"])[1])
        best, last = trained(result.problem), trained(result.last_problem)
        return replace(result, problem=best, last_problem=last, equilibrium=None, state=None)

    def receive(self, sent: FitResult) -> FitResult:
        """A result that was sent back, with its problems."""
        design, _ = split(self.problem(), self.options["where"])
        whole = lambda trained: design.problem(jax.tree.map(jax.numpy.asarray, trained))
        return replace(sent, problem=whole(sent.problem), last_problem=whole(sent.last_problem))


def _start(folder: Any, number: int) -> Checkpoint | None:
    if folder is None:
        return None
    kept = folder if isinstance(folder, Checkpoint) else Checkpoint(folder)
    return replace(kept, path=Path(kept.path) / f"start-{number:04d}")


def _made(method: Any) -> Any:
    """The method itself, where a function that makes it was given."""
    import optax

    if isinstance(method, optax.GradientTransformation | Method) or not callable(method):
        return method
    return method()


def _outcome(call: Callable[[], Any]) -> Any:
    try:
        return call()
    except Exception as error:
        return error


def _side_by_side(tasks: list[_Task], how: Literal["map", "vmap"], keep: Callable[[int, Any], None]) -> None:
    problems = {}
    for number, task in enumerate(tasks):
        problem = _outcome(task.problem)
        if isinstance(problem, Exception):
            keep(number, problem)
        else:
            problems[number] = problem
    numbers, options = list(problems), {name: x for name, x in tasks[0].options.items() if name != "progress"}
    if problems:
        method = as_method(_made(tasks[0].method), stacklevel=5)
        fit_together(list(problems.values()), method, how, lambda n, found: keep(numbers[n], found), **options)


def _from_workers(executor: Any, tasks: list[_Task]) -> Iterator[tuple[int, Any]]:
    """The outcomes of the tasks as they come in. Jobs are looked at, not waited for: not every executor has futures."""
    jobs = {number: executor.submit(task.send) for number, task in enumerate(tasks)}
    try:
        while jobs:
            for number in [number for number, job in jobs.items() if job.done()]:
                job, task = jobs.pop(number), tasks[number]
                yield number, _outcome(lambda job=job, task=task: task.receive(job.result()))
            time.sleep(_POLL)
    finally:
        for job in jobs.values():
            job.cancel()


def _check_together(together: str, method: Any, executor: Any, folder: Any, options: dict[str, Any]) -> None:
    if together not in ("map", "vmap"):
        raise ValueError(f"fit_many: together must be 'map', 'vmap' or None; got {together!r}.")
    if executor is not None or folder is not None:
        raise ValueError("fit_many: fits that go on together have neither an executor nor a folder; use one of them.")
    made = as_method(_made(method), stacklevel=5)
    if type(made).accept is not Method.accept or not made.needs_gradient:
        raise ValueError(
            "fit_many: fits go on together with optax's optimisers alone, or methods that take every design; "
            f"got {type(made).__name__}."
        )
    unknown = sorted(options.keys() - set(_TOGETHER))
    if unknown:
        raise ValueError(f"fit_many: with together={together!r} there is no option {unknown[0]!r}; leave it out.")
    if "refuse" in options and options["refuse"].rise is not None:
        raise ValueError(f"fit_many: with together={together!r} there is no Refuse(rise=…); leave it out.")


def _check_sendable(task: _Task, executor: Any) -> None:
    if not isinstance(executor, futures.ProcessPoolExecutor):
        return
    parts = {"the problem": task.item, "make": task.make, "the method": task.method, "an option": task.options}
    for name, part in parts.items():
        try:
            pickle.dumps(part)
        except Exception as error:
            raise ValueError(
                f"fit_many: {name} cannot be sent to another process ({error}). Functions must stand at the top of an "
                "importable file; give an optimiser as a function that makes it, such as "
                "functools.partial(optax.adam, 0.1)."
            ) from error
