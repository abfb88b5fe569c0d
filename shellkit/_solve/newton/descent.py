"""The way down along one step: a search for its length, then corrections with its factor."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int, Scalar

from .corrections import Correction, Corrections
from .line_search import LineSearch, Onwards
from .objective import Objective
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
    objective: Objective,
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
    unit = objective.length
    correctable = step.regular & ~step.mixed & (step.size < unit)
    noise = jnp.asarray(jnp.inf) if line_search is None else line_search.resolution(step, unit)

    def attempt(now: _Progress) -> _Progress:
        correction = now.correction
        direction, length = step.direction, now.length
        if correction is not None:
            direction, length = correction.direction, jnp.where(now.searching, now.length, 1.0)
        y = now.point.y + length * direction
        trial = Point.of(y, *objective.value_and_gradient(y))
        ratio = trial.norm / now.point.norm

        accepted = jnp.array(True)
        if line_search is not None:
            accepted = line_search.accepts(step, now.point, now.length, trial, ratio, noise)
        if objective.feasible is not None:
            accepted = objective.feasible(now.point.y, y) & accepted
        if corrections is not None:
            accepted = jnp.where(now.searching, accepted, corrections.accepts(now.point, trial, ratio, noise))
        accepted = trial.finite & (step.mixed | accepted)

        onwards = Onwards(jnp.array(False), jnp.where(accepted, now.length, 0.0))
        if line_search is not None:
            onwards = line_search.onwards(step, now.point, now.length, now.tries, accepted, unit)
        tries, searching, reached_length = now.tries + 1, onwards.again, onwards.length
        if corrections is not None and correction is not None:
            settled = correction.on & (correction.size <= target)
            first = correctable & (now.length == 1)
            again = accepted & corrections.pays(correction, now.tries, first, ratio, target) & ~settled
            tries = jnp.where(again & now.searching, 0, tries)
            searching = now.searching & searching
            reached_length = jnp.where(now.searching, reached_length, now.length)
            gradients = now.point.gradient, trial.gradient
            correction = corrections.after(correction, gradients, again, settled, solve)
        return _Progress(choose(accepted, trial, now.point), reached_length, tries, searching, correction)

    # Uphill there is nothing to find; off a saddle it may be flat.
    downhill = (step.slope <= 0) | step.escaping
    correction = None if corrections is None else corrections.begin(step)
    start = _Progress(step.start, jnp.ones_like(step.slope), jnp.zeros((), int), downhill, correction)
    end = jax.lax.while_loop(lambda now: now.going, attempt, start)
    settled = jnp.array(False) if end.correction is None else end.correction.settled
    return Reached(end.point, jnp.where(downhill, end.length, 0.0), settled)
