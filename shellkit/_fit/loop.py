"""What happens in one step of a fit: a design is tried and accepted or refused, recorded, and updated. All that a fit
carries from one step to the next is a `Run`, replaced as a whole, so that an interrupt finds it consistent."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .checkpoint import Stored, belongs
from .choices import Refuse, WarmStart
from .design import Design
from .fingerprint import describe
from .history import FitResult, FitStep, History, Scalar
from .methods.base import Accepted, Course, Method, Objective
from .step import Evaluation, assess, compile_ahead, evaluate, move, predict, strong


# A warm start is said to have parted from rest where the losses differ by this fraction of the loss, unless both are
# as good as zero beside the loss of the first step.
_PARTED, _ZERO = 1e-3, 1e-6
_RISES = 4  # designs in a row that are refused for a loss that rises; the next one is taken


@runtime_checkable
class Trainable(Protocol):
    """What `fit` asks of a problem: a pytree with this method, differentiable in its floating-point arrays."""

    def objective(self, start: Any = None) -> tuple[Any, tuple[dict[str, Any], Any]]:
        """The loss, with the value of each term by name and the equilibrium (or `None`), relaxed from `start`."""
        ...


class Run(NamedTuple):
    """A fit between two steps. `course` is where it goes next, in the optimiser's variables; `last` and `best` are
    values of the trained arrays. Their equilibria are kept for warm starts only."""

    step: int
    course: Course
    last: dict[str, Array]
    best: dict[str, Array]
    best_loss: float
    best_step: int
    equilibrium: Any
    best_equilibrium: Any
    seconds: float


class Tried(NamedTuple):
    """A design, its scalars on the host, and what it took to get there: the course that proposed it, and how many
    designs were refused before. `accepted` is the answer of the method, once it was asked."""

    found: Evaluation
    loss: float
    terms: dict[str, float]
    others: dict[str, Scalar]
    start: Any
    course: Course
    refused: int
    accepted: Accepted | None = None


@dataclass(frozen=True)
class Loop:
    """The parts of a fit that stay the same from step to step, and what is done with them."""

    design: Design
    method: Method
    refuse: Refuse
    warm: WarmStart | None = None
    warned: set[str] = field(default_factory=set)  # each kind of warning is given once in a fit

    def objective(self, start: Any = None) -> Objective:
        """What is minimised, relaxed from an equilibrium or (`None`) from rest."""
        return Objective(self.design, start, self.refuse.rise)

    def begin(self, values: dict[str, Array]) -> Run:
        """The fit before its first step."""
        free = strong(self.design.free(values))
        state = strong(self.method.init(self.objective(), free))
        return Run(
            step=0,
            course=Course(free, jax.tree.map(jnp.zeros_like, free), 1.0, state),
            last=values,
            best=values,
            best_loss=float("inf"),
            best_step=0,
            equilibrium=None,
            best_equilibrium=None,
            seconds=0.0,
        )

    def compile_ahead(self, run: Run) -> None:
        """Compiles what the first step needs, several programs at a time."""
        if self.method.needs_gradient:
            compile_ahead(self.design, run.course.anchor)

    def next_design(self, run: Run, history: History) -> Tried | str:
        """The next design on the course that is acceptable, or why there is none: `"refused"` or `"converged"`."""
        course, failures, rises = run.course, 0, 0
        for refused in range(self.refuse.most + 1):
            if self.method.arrived(course):
                return "converged"
            tried, objection = self._try(run, course, refused)
            rising = objection is None and rises < _RISES and self._rises(tried.loss, history)
            rises += rising
            if objection is None and not rising:
                tried, objection = self._judged(tried)
                if tried.accepted is not None and objection is None:
                    return tried
            if objection is not None and run.step == 0:
                raise ValueError(
                    f"fit cannot begin: at the starting design {objection}. Start from another design, relax it with "
                    "problem() to see its diagnostics, or pass refuse=Refuse(unconverged=False) if the minimiser stops "
                    "short of its tolerance as a rule."
                )
            course = self.method.refuse(course)
            if objection is None:
                continue
            failures += 1
            self._warn(
                "refused",
                f"fit: the design of step {run.step} was refused, as {objection}. A shorter step is tried from the "
                "last good design, then a shorter one still; the history counts such designs in its column 'refused'.",
            )
        kind = "were refused" if failures else "had no smaller loss"
        self._warn(
            "stopped",
            f"fit: stopped at step {run.step}, as {self.refuse.most + 1} designs in a row {kind}; "
            "the best design is kept.",
        )
        return "refused"

    def row(self, run: Run, tried: Tried, history: History, seconds: float) -> dict[str, Scalar]:
        """The next row of the history, for an accepted design."""
        assert tried.accepted is not None
        row = {**tried.others, "refused": tried.refused, **tried.accepted.columns, "seconds": seconds}
        if self.warm is not None:
            row["warm_gap"] = float("nan")
            if tried.start is not None and run.step % self.warm.check_every == 0:
                row["warm_gap"] = self._gap(run, tried.found.free, tried.loss, history, f"at step {run.step}")
        return with_terms(tried.loss, tried.terms, row)

    def info(self, run: Run, tried: Tried, steps: int, history: History) -> FitStep:
        """What the callbacks are told."""
        problem = self.design.problem(tried.found.values)
        return FitStep(run.step, steps, problem, tried.found.equilibrium, tried.loss, tried.terms, history)

    def after(self, run: Run, tried: Tried, history: History) -> Run:
        """The fit after the method's update from an accepted design, the last row of the history."""
        assert tried.accepted is not None
        found, warm = tried.found, self._kept(tried.found)
        update, state = strong(self.method.update(self.objective(warm), found, tried.accepted.state))
        return self._better(run, tried)._replace(
            step=run.step + 1,
            course=Course(found.free, update, min(1.0, 2 * float(tried.course.scale)), state),
            last=found.values,
            equilibrium=warm,
            seconds=float(history.row(-1)["seconds"]),
        )

    def finish(self, run: Run, history: History) -> Run:
        """Gives the design after the last update its chance to be the best one."""
        tried, objection = self._try(run, run.course, 0)
        run = run if objection is not None else self._better(run, tried)
        if self.warm is not None:
            self._gap(run, strong(self.design.free(run.best)), run.best_loss, history, "for the best design")
        return run

    def result(self, run: Run, history: History, stopped: str) -> FitResult:
        """The fit, as its caller sees it."""
        return FitResult(
            problem=self.design.problem(run.best),
            best_loss=float(run.best_loss),
            best_step=int(run.best_step),
            equilibrium=run.best_equilibrium,
            last_problem=self.design.problem(run.last),
            history=history,
            stopped=stopped,
            state=run.course.state,
        )

    def identity(self, values: dict[str, Array], state: Any) -> dict[str, Any]:
        """What a checkpoint must agree with to be one of this fit, in groups."""
        choices = {"warm_start": "rest" if self.warm is None else self.warm.guess}
        if self.method.name is not None:
            choices["solver"] = self.method.name
        if self.warm is not None:
            choices["check_every"] = str(self.warm.check_every)
        return {
            "trained": {name: f"{x.dtype}{list(x.shape)}" for name, x in values.items()},
            "problem": describe(self.design.frozen),
            "bounds": describe(self.design.intervals),
            "start": describe(values),
            "optimiser": describe(state, contents=False),
            "choices": choices,
        }

    def stored(self, run: Run, history: History, identity: Mapping[str, Any], stopped: str) -> tuple[dict, Any]:
        """The header and the arrays of a checkpoint."""
        header = {
            "names": self.design.names,
            "step": run.step,
            "scale": float(run.course.scale),
            "best_loss": run.best_loss,
            "best_step": run.best_step,
            "seconds": run.seconds,
            "stopped": stopped,
            "history": history.lists(),
            "fingerprint": identity,
        }
        return header, _arrays(run)

    def resume(self, stored: Stored, identity: Mapping[str, Any], like: Run) -> tuple[Run, History]:
        """The fit as a checkpoint left it."""
        belongs(stored, identity)
        header = stored.header
        if self.warm is not None:
            shapes = eqx.filter_eval_shape(self._evaluate, like.course.anchor, None)
            like = like._replace(equilibrium=shapes.equilibrium, best_equilibrium=shapes.equilibrium)
        best, last, anchor, update, state, equilibrium, best_equilibrium = stored.restore(_arrays(like))
        run = Run(
            step=header["step"],
            course=Course(anchor, update, header["scale"], state),
            last=last,
            best=best,
            best_loss=header["best_loss"],
            best_step=header["best_step"],
            equilibrium=equilibrium,
            best_equilibrium=best_equilibrium,
            seconds=header["seconds"],
        )
        return run, History(header["history"])

    def _evaluate(self, free: dict[str, Array], start: Any) -> Evaluation:
        look = evaluate if self.method.needs_gradient else assess
        return look(self.design, free, start)

    def _try(self, run: Run, course: Course, refused: int) -> tuple[Tried, str | None]:
        free = move(course.anchor, course.update, jnp.asarray(np.float64(course.scale)))
        start = run.equilibrium
        if start is not None and self.warm is not None and self.warm.guess == "predicted":
            start = predict(self.design, course.anchor, free, start)
        tried, objection = self._tried(free, start, course, refused)
        # Who wants no leaps is better served by a shorter step on the same branch.
        stays = self.refuse.rise is not None and refused < _RISES
        if objection is not None and start is not None and not stays:
            tried, objection = self._tried(free, None, course, refused)
        return tried, objection

    def _tried(self, free: dict[str, Array], start: Any, course: Course, refused: int = 0) -> tuple[Tried, str | None]:
        found = self._evaluate(free, start)
        scalars = (found.loss, found.terms, found.diagnostics)
        loss, terms, others = jax.tree.map(lambda x: x.item(), jax.device_get(scalars))
        tried = Tried(found, loss, terms, others, start, course, refused)
        return tried, objection(self.refuse, loss, others, found.equilibrium) or _not_finite(found)

    def _judged(self, tried: Tried) -> tuple[Tried, str | None]:
        """A sound design with the answer of the method, and what is wrong with the gradient if there is one."""
        accepted = self.method.accept(self.objective(tried.start), tried.found, tried.course)
        if accepted is None:
            return tried, None
        norm = accepted.found.gradient_norm
        others = tried.others if norm is None else {"gradient_norm": norm.item(), **tried.others}
        return tried._replace(found=accepted.found, others=others, accepted=accepted), _not_finite(accepted.found)

    def _rises(self, loss: float, history: History) -> bool:
        if self.refuse.rise is None or history.steps == 0:
            return False
        before = float(history.row(-1)["loss"])
        return loss > before + self.refuse.rise * abs(before)

    def _better(self, run: Run, tried: Tried) -> Run:
        if not tried.loss < run.best_loss:
            return run
        return run._replace(
            best=tried.found.values,
            best_loss=tried.loss,
            best_step=run.step,
            best_equilibrium=self._kept(tried.found),
        )

    def _kept(self, found: Evaluation) -> Any:
        return None if self.warm is None else found.equilibrium

    def _gap(self, run: Run, free: dict[str, Array], loss: float, history: History, place: str) -> float:
        rest, objection = self._tried(free, None, run.course)
        if objection is not None:
            return float("nan")
        if abs(loss - rest.loss) > max(_PARTED * abs(rest.loss), _ZERO * abs(history.row(0)["loss"])):
            self._warn(
                "parted",
                f"fit: {place} the warm-started relaxation has parted from the one from rest: their losses are "
                f"{loss:.6g} and {rest.loss:.6g}. The shell has several equilibria; leave out warm_start for designs "
                "that are to be reached from rest.",
                stacklevel=6,
            )
        return loss - rest.loss

    def _warn(self, kind: str, message: str, stacklevel: int = 5) -> None:
        if kind not in self.warned:
            self.warned.add(kind)
            warnings.warn(message, stacklevel=stacklevel)


def with_terms(loss: float, terms: Mapping[str, float], row: Mapping[str, Scalar]) -> dict[str, Scalar]:
    """A row of the history with the loss and its terms before the other columns.

    **Raises:** `ValueError` for a term named as a column.
    """
    taken = terms.keys() & {"loss", *row}
    if taken:
        raise ValueError(f"a loss term has the name of a column of the history, {taken.pop()!r}: rename its class.")
    return {"loss": loss, **terms, **row}


def objection(refuse: Refuse, loss: float, diagnostics: Mapping[str, Any], equilibrium: Any = None) -> str | None:
    """What is wrong with a design by its scalars, if anything is; the equilibrium says why it did not converge."""
    if refuse.unconverged and not diagnostics.get("converged", True):
        left, why = diagnostics["relaxation_gradient_norm"], "" if equilibrium is None else f"; {equilibrium.result}"
        return f"the relaxation did not converge (|∇E| = {left:.3g}{why})"
    return None if np.isfinite(loss) else f"the loss is {loss}"


def _arrays(run: Run) -> tuple:
    # The first two are all that `load_checkpoint` reads.
    course = run.course
    return run.best, run.last, course.anchor, course.update, course.state, run.equilibrium, run.best_equilibrium


def _not_finite(found: Evaluation) -> str | None:
    if found.gradient is None or found.gradient_norm is None or np.isfinite(found.gradient_norm.item()):
        return None
    names = [name for name, g in found.gradient.items() if not np.isfinite(np.asarray(g)).all()]
    return f"the gradient is not finite in {', '.join(names)}"
