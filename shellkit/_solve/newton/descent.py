"""The way down along one step: a search for its length, then corrections with its factor."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int, Scalar

from .corrections import Correction, Corrections
from .line_search import LineSearch, Onwards
from .objective import NewtonObjective
from .points import Point, Reached, Step, choose


class _Progress(eqx.Module):
    """Where a step has come to."""

    point: Point
    length: Scalar
    tries: Int[Array, ""]
    searching: Bool[Array, ""]
    correction: Correction | None

    @property
    def going(self) -> Bool[Array, ""]:
        """Whether there is more to try."""
        return self.searching if self.correction is None else self.searching | self.correction.on


def descend(
    objective: NewtonObjective,
    step: Step,
    line_search: LineSearch | None,
    corrections: Corrections | None,
    solve: Callable[[Array], Array],
    target: Scalar,
) -> Reached:
    """Halve the step until it is feasible and lowers the energy, or add steps twice as long while these lower it
    further; then, near a minimum, correct it as long as that pays. A mixed step is taken as it is.

    One loop does both, so that the energy is compiled once.

    **Arguments:**

    - `objective`, `step`: what is minimised, and along what.
    - `line_search`: `None` takes every step in full, if the energy is finite there.
    - `corrections`: `None` for none.
    - `solve`: with the factor of the step.
    - `target`: the size of a correction that ends the search for a minimum.
    """
    way = _Way(objective, step, line_search, corrections, solve, target)
    # Uphill there is nothing to find; off a saddle it may be flat.
    downhill = (step.slope <= 0) | step.escaping
    correction = None if corrections is None else corrections.begin(step)
    start = _Progress(step.start, jnp.ones_like(step.slope), jnp.zeros((), int), downhill, correction)
    noise = jnp.asarray(jnp.inf) if line_search is None else line_search.resolution(step, objective.length)
    end = jax.lax.while_loop(lambda now: now.going, lambda now: way.attempt(now, noise), start)
    settled = jnp.array(False) if end.correction is None else end.correction.settled
    return Reached(end.point, jnp.where(downhill, end.length, 0.0), settled)


class _Way(eqx.Module):
    """What `descend` is given, and one trial of it."""

    objective: NewtonObjective
    step: Step
    line_search: LineSearch | None
    corrections: Corrections | None
    solve: Callable[[Array], Array]
    target: Scalar

    def attempt(self, now: _Progress, noise: Scalar) -> _Progress:
        """One more trial, of the search or of a correction."""
        correction = now.correction
        direction, length = self.step.direction, now.length
        if correction is not None:
            direction, length = correction.direction, jnp.where(now.searching, now.length, 1.0)
        y = now.point.y + length * direction
        trial = Point.of(y, *self.objective.value_and_gradient(y))
        ratio = trial.norm / now.point.norm
        accepted = self.accepts(now, trial, ratio, noise)

        onwards = Onwards(jnp.array(False), jnp.where(accepted, now.length, 0.0))
        if self.line_search is not None:
            unit = self.objective.length
            onwards = self.line_search.onwards(self.step, now.point, now.length, now.tries, accepted, unit)
        tries, searching, length = now.tries + 1, onwards.again, onwards.length
        if self.corrections is not None and correction is not None:
            correction = self.corrected(now, correction, trial, ratio, accepted)
            tries = jnp.where(correction.on & now.searching, 0, tries)
            searching = now.searching & searching
            length = jnp.where(now.searching, length, now.length)
        return _Progress(choose(accepted, trial, now.point), length, tries, searching, correction)

    def accepts(self, now: _Progress, trial: Point, ratio: Scalar, noise: Scalar) -> Bool[Array, ""]:
        """Whether to go to a trial point."""
        accepted = jnp.array(True)
        if self.line_search is not None:
            accepted = self.line_search.accepts(self.step, now.point, now.length, trial, ratio, noise)
        if self.objective.feasible is not None:
            accepted = self.objective.feasible(now.point.y, trial.y) & accepted
        if self.corrections is not None:
            better = self.corrections.accepts(now.point, trial, ratio, noise)
            accepted = jnp.where(now.searching, accepted, better)
        return trial.finite & (self.step.mixed | accepted)

    def corrected(
        self, now: _Progress, last: Correction, trial: Point, ratio: Scalar, accepted: Bool[Array, ""]
    ) -> Correction:
        """The correction that follows on a trial, if it pays."""
        assert self.corrections is not None
        step = self.step
        near = step.regular & ~step.mixed & (step.size < self.objective.length)
        settled = last.on & (last.size <= self.target)
        pays = self.corrections.pays(last, now.tries, near & (now.length == 1), ratio, self.target)
        gradients = now.point.gradient, trial.gradient
        return self.corrections.after(last, gradients, accepted & pays & ~settled, settled, self.solve)
