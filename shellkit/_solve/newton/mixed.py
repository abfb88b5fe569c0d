"""Newton's method with the strains as unknowns of their own, for energies that are a narrow curved valley. Its steps
are taken in full, and what they come to is kept only if it is lower than where they began."""

from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int, PyTree, Scalar

from ..._citation.papers import MAGISANO_2017
from .points import Point, Reached, Step, choose


class MixedState(eqx.Module):
    """How far mixed steps have come."""

    strains: PyTree[Array]
    on: Bool[Array, ""]
    """The next step is a mixed one."""
    origin: Point
    """What the search comes back to if these steps are in vain."""
    steps: Int[Array, ""]
    attempts: Int[Array, ""]

    @classmethod
    def off(cls, strains: PyTree[Array], point: Point) -> "MixedState":
        """Not begun."""
        no, zero = jnp.array(False), jnp.zeros((), jnp.int32)
        return cls(strains, no, point, zero, zero)


class MixedSteps(eqx.Module):
    r"""Steps with the strains as unknowns of their own, where the energy is a narrow curved valley, as that of a thin
    shell is: they begin where a step of a convex model has to be cut short, and follow the valley to its end, or are
    dropped.

    With strains $e(y)$ and an energy $\psi(e)$ the stationary point of
    $\psi(\varepsilon) + \sigma \cdot (e(y) - \varepsilon)$ in $y$, $\varepsilon$ and $\sigma$ is the minimum sought.
    Newton's step in all three, reduced to $y$, has a Hessian of the same pattern, in which the stress is what the step
    before made of it to first order. A step that turns a thin shell stretches it to second order by far more than it
    can bear, which the energy counts and these stresses do not: the number of steps does not depend on the thickness.

    Of no use where the function does not give its strains.

    ??? cite "Source"
        D. Magisano, L. Leonetti, G. Garcea, *How to improve efficiency and robustness of the Newton method in
        geometrically non-linear structural problem discretized via displacement-based finite elements*, Computer
        Methods in Applied Mechanics and Engineering 313 (2017) 986–1005, there with stresses alone; with strains as
        well the material is looked at where it will be.

    **Arguments:**

    - `narrow`: a step of a convex model that has to be cut to this part, or less, is in such a valley,
    - `small`: unless it is smaller than this to begin with, in units of the typical length.
    - `arrived`: the size of the last of these steps, in the same units.
    - `farthest`: the size of a step that leads nowhere, in the same units.
    - `max_steps`: the most of these steps in a row.
    - `max_attempts`: how often they may begin.
    """

    papers: ClassVar[tuple[str, ...]] = (MAGISANO_2017,)
    narrow: float = eqx.field(static=True, default=0.125)
    small: float = eqx.field(static=True, default=1e-3)
    arrived: float = eqx.field(static=True, default=1e-6)
    farthest: float = eqx.field(static=True, default=1e3)
    max_steps: int = eqx.field(static=True, default=15)
    max_attempts: int = eqx.field(static=True, default=3)

    def after(
        self,
        state: MixedState,
        step: Step,
        reached: Reached,
        trusted: Bool[Array, ""],
        unit: Scalar,
        ahead: Callable[[Array], PyTree[Array]],
    ) -> tuple[MixedState, Point]:
        """What follows on a step, and where it ends: where it came to; or, of a step that had to be cut, where it would
        have led; or, after steps in vain, where they began.

        **Arguments:**

        - `state`: how far these steps have come.
        - `step`, `reached`: the step that was taken, and where it led.
        - `trusted`: whether its matrix is positive definite, without a shift, and the search is not over.
        - `unit`: the typical length.
        - `ahead`: where a step takes the strains.
        """
        point, whole = reached.point, reached.length == 1
        sound = state.on & trusted & point.finite & whole
        sound = sound & (step.size < self.farthest * unit) & (state.steps < self.max_steps)
        arrived = sound & (step.size <= self.arrived * unit)
        continues = sound & ~arrived
        in_vain = state.on & ~continues & ~(arrived & (point.value < state.origin.value))
        cut = (reached.length > 0) & (reached.length <= self.narrow) & (step.size > self.small * unit)
        begins = trusted & ~state.on & cut & (state.attempts < self.max_attempts)
        following = MixedState(
            strains=jax.lax.cond(continues | begins, lambda: ahead(step.direction), lambda: state.strains),
            on=continues | begins,
            origin=choose(begins, point, state.origin),
            steps=jnp.where(continues, state.steps + 1, 0),
            attempts=state.attempts + begins.astype(jnp.int32),
        )
        in_full = Point(step.start.y + step.direction, point.value, point.gradient, point.norm)
        return following, choose(begins, in_full, choose(in_vain, state.origin, point))
