"""How far to go along a direction: backtracking, and lengthening where the model is stiffer than the energy."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int, Scalar

from ..._citation.papers import NOCEDAL_2006
from .points import Point, Step


class Onwards(eqx.Module):
    """What a search does after a trial."""

    again: Bool[Array, ""]
    """Whether it goes on."""
    length: Scalar
    """The length to try next, or that at which the search ends; zero where no step was found."""


class LineSearch(eqx.Module):
    """Backtracking from the full step until the energy falls by part of what its slope promises; and, where the step is
    too short, further steps, each twice as long as the last, while the energy falls: off a saddle, and where the model
    is known to be stiffer than the energy.

    Where the energy has no digits left to fall by, a smaller gradient decides.

    ??? cite "Source"
        Algorithm 3.1 of J. Nocedal and S. Wright, *Numerical Optimization*, 2nd edition (2006). On differences of
        energies that are rounding, and what gradients say there, see W. Hager and H. Zhang, *A new conjugate gradient
        method with guaranteed descent and an efficient line search*, SIAM J. Optim. 16 (2005) 170–192.

    **Arguments:**

    - `armijo`: the part of the decrease that the slope promises, for a step to be taken.
    - `noise`: how many roundings of the energy are no difference.
    - `floor`: steps below this fraction of the typical length may be too small for the energy to show.
    - `short`: a step that is cut to less than this part says that its model is not to be trusted.
    - `max_tries`: the most changes of the length in one step.
    """

    papers: ClassVar[tuple[str, ...]] = (NOCEDAL_2006,)
    armijo: float = eqx.field(static=True, default=1e-4)
    noise: float = eqx.field(static=True, default=64.0)
    floor: float = eqx.field(static=True, default=1e-5)
    short: float = eqx.field(static=True, default=0.2)
    max_tries: int = eqx.field(static=True, default=40)

    def resolution(self, step: Step, unit: Scalar) -> Scalar:
        """The difference of energies that says nothing.

        **Arguments:**

        - `step`: along which is searched.
        - `unit`: the typical length.
        """
        # An energy close to zero is a sum of squares of differences: it has fewer digits than its size says.
        tiny = step.regular & (step.size < self.floor * unit)
        noise = self.noise * jnp.finfo(step.start.y.dtype).eps
        return jnp.where(tiny, jnp.inf, noise * jnp.abs(step.start.value))

    def accepts(
        self, step: Step, now: Point, length: Scalar, trial: Point, ratio: Scalar, noise: Scalar
    ) -> Bool[Array, ""]:
        """Whether a trial is good enough, or, of a step that is made longer, better than what there is.

        **Arguments:**

        - `step`: along which is searched.
        - `now`: the best point so far: the start, or that of a shorter step.
        - `length`, `trial`: the part of the step that is tried, and where it leads.
        - `ratio`: of the norms of the gradient there and at the best point.
        - `noise`: the difference of energies that says nothing.
        """
        lower = trial.value <= step.start.value + self.armijo * length * step.slope
        # Not so at a saddle, where the gradient is small to begin with.
        level = (jnp.abs(trial.value - step.start.value) <= noise) & (ratio <= 1) & ~step.escaping
        downwards = trial.value < now.value - noise
        return jnp.where(step.escaping | (length > 1), downwards, lower | level)

    def onwards(
        self, step: Step, now: Point, length: Scalar, tries: Int[Array, ""], accepted: Bool[Array, ""], unit: Scalar
    ) -> Onwards:
        """What follows on a trial.

        **Arguments:**

        - `step`, `now`, `length`: as for `accepts`.
        - `tries`: how many there were before.
        - `accepted`: whether the trial was.
        - `unit`: the typical length.
        """
        # Off a saddle steps double while it goes down; so do short ones where the model is stiffer than the energy.
        short = length * step.size < 0.5 * unit
        stiffer = ~step.regular & ((length > 1) | (accepted & (length == 1) & short))
        lengthening = jnp.where(step.escaping, accepted | (now.value < step.start.value), stiffer)
        again = jnp.where(lengthening, accepted, ~accepted) & (tries < self.max_tries)
        ended = jnp.where(~accepted & ~lengthening, 0.0, length)
        return Onwards(again, jnp.where(again, length * jnp.where(lengthening, 2.0, 0.5), ended))

    def floored(self, size: Scalar, length: Scalar, unit: Scalar) -> Bool[Array, ""]:
        """Whether a Newton step is so tiny that it is made of rounding, as even the gradient rejects it.

        **Arguments:**

        - `size`, `length`: the largest entry of the step, and the part of it that was taken.
        - `unit`: the typical length.
        """
        return (size < self.floor * unit) & (length < self.short)
