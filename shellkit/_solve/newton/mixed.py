"""Newton's method with the strains as unknowns of their own, for shells so thin that the energy is a narrow curved
valley. Its steps are taken in full, and what they come to is kept only if it is lower than where they began."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree, Scalar

from .points import Point, choose


_NARROW = 0.125  # a step of a convex model that has to be cut to this part, or less, is in such a valley
_SMALL = 1e-3  # unless it is smaller than this to begin with, in units of the typical length
_ARRIVED = 1e-6  # the size of the last step, in the same units
_FARTHEST = 1e3
_MAX_STEPS, _MAX_ATTEMPTS = 15, 3


class Apart(NamedTuple):
    """What the method asks of an energy beside its derivatives: where `y` has the strains; and the derivatives with
    strains apart, as `(y, strains, whether to look at those) -> ` what `derivatives` gives, and where a step takes the
    strains."""

    begin: Callable[[Array], PyTree[Array]]
    derivatives: Callable[[Array, PyTree[Array], Array], tuple[Any, ...]]


class Mixed(eqx.Module):
    r"""How far the method has come; a part of the state of [`shellkit.SparseNewton`][].

    With strains $e(y)$ and an energy $\psi(e)$ the stationary point of
    $\psi(\varepsilon) + \sigma \cdot (e(y) - \varepsilon)$ in $y$, $\varepsilon$ and $\sigma$ is the minimum sought.
    Newton's step in all three, reduced to $y$, has a Hessian of the same pattern, in which the stress is what the step
    before made of it to first order. A step that turns a thin shell stretches it to second order by far more than it
    can bear, which the energy counts and these stresses do not: the number of steps does not depend on the thickness.

    ??? cite "Source"
        D. Magisano, L. Leonetti, G. Garcea, *How to improve efficiency and robustness of the Newton method in
        geometrically non-linear structural problem discretized via displacement-based finite elements*, Computer
        Methods in Applied Mechanics and Engineering 313 (2017) 986–1005, there with stresses alone; with strains as
        well the material is looked at where it will be.
    """

    strains: PyTree[Array]
    on: Bool[Array, ""]  # the next step is of this kind
    origin: Point  # what the search comes back to if these steps are in vain
    steps: Int[Array, ""]
    attempts: Int[Array, ""]

    @classmethod
    def off(cls, strains: PyTree[Array], point: Point) -> "Mixed":
        """Not begun."""
        no, zero = jnp.array(False), jnp.zeros((), jnp.int32)
        return cls(strains, no, point, zero, zero)

    def after(
        self,
        point: Point,
        direction: Float[Array, " n"],
        size: Scalar,
        moved: Point,
        length: Scalar,
        trusted: Bool[Array, ""],
        unit: Scalar,
        ahead: Callable[[], PyTree[Array]],
    ) -> tuple["Mixed", Point]:
        """What follows on a step, and where it ends: where it came to; or, of a step that had to be cut, where it would
        have led; or, after steps in vain, where they began.

        **Arguments:**

        - `point`, `direction`, `size`: where the step was taken, all of it, and its largest entry.
        - `moved`, `length`: where it came to, and the part of it that was taken.
        - `trusted`: whether its matrix is positive definite, without a shift, and the search is not over.
        - `unit`: the typical length.
        - `ahead`: where all of it takes the strains.
        """
        sound = self.on & trusted & moved.finite & (length == 1) & (size < _FARTHEST * unit) & (self.steps < _MAX_STEPS)
        arrived = sound & (size <= _ARRIVED * unit)
        going = sound & ~arrived
        vain = self.on & ~going & ~(arrived & (moved.value < self.origin.value))
        narrow = trusted & ~self.on & (length > 0) & (length <= _NARROW) & (size > _SMALL * unit)
        begins = narrow & (self.attempts < _MAX_ATTEMPTS)
        mixed = Mixed(
            strains=jax.lax.cond(going | begins, ahead, lambda: self.strains),
            on=going | begins,
            origin=choose(begins, moved, self.origin),
            steps=jnp.where(going, self.steps + 1, 0),
            attempts=self.attempts + begins.astype(jnp.int32),
        )
        after_all = Point(point.y + direction, moved.value, moved.gradient, moved.norm)
        return mixed, choose(begins, after_all, choose(vain, self.origin, moved))
