"""A loss that keeps the material's stretch within what it bears."""

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

from .._actuation.base import Actuation
from .._equilibrium import Equilibrium
from .._geometry.forms import components, determinant, first_form
from .._geometry.rowwise import over, root
from .base import LeastSquaresLoss


class StrainLimit(LeastSquaresLoss):
    r"""Penalty on principal stretches outside bounds: zero while every face is within them.

    $\sum_f w_f \sum_{i=1,2} \max(0, \lambda_i - \lambda^+, \lambda^- - \lambda_i)^2$ with $\lambda_i^2$ the
    eigenvalues of $g_r^{-1} g$, of the relaxed metric $g$ against the actuated rest metric $g_r$, and $w_f$ the rest
    areas, summing to one. This is the elastic stretch: growth itself does not count.

    A penalty, not a barrier: bounds are exceeded a little where that pays. Its gradient is continuous; second
    derivatives jump at the bounds, and are not defined where both stretches are equal and beyond the same bound.

    **Arguments:**

    - `lower`, `upper`: the bounds $\lambda^- < \lambda^+$ on the stretch, 1 being unstretched. `lower=0` and
        `upper=jnp.inf` leave one side open.

    **Returns:**

    When called, a scalar without unit.

    **Raises:**

    `ValueError` unless $0 \le \lambda^- < \lambda^+$, each one number.
    """

    lower: Float[Array, ""]
    upper: Float[Array, ""]

    def __init__(self, lower: ArrayLike, upper: ArrayLike):
        self.lower, self.upper = jnp.asarray(lower, dtype=float), jnp.asarray(upper, dtype=float)
        if self.lower.shape != () or self.upper.shape != ():
            raise ValueError(
                f"StrainLimit: lower has shape {self.lower.shape}, upper {self.upper.shape}; give one number each, "
                "shape ()."
            )
        if not isinstance(self.lower, Tracer) and not isinstance(self.upper, Tracer):
            low, high = float(np.asarray(self.lower)), float(np.asarray(self.upper))
            if not 0 <= low < high:
                raise ValueError(f"StrainLimit: lower is {low}, upper {high}; 0 <= lower < upper is needed.")

    def residuals(self, equilibrium: Equilibrium, actuation: Actuation) -> Float[Array, " m"]:
        stretches = jnp.stack(principal_stretches(equilibrium))
        areas = jnp.sqrt(determinant(components(equilibrium.rest.metric)))
        excess = jnp.maximum(stretches - self.upper, 0.0) + jnp.maximum(self.lower - stretches, 0.0)
        return (jnp.sqrt(areas / jnp.sum(areas)) * excess).ravel()

    @property
    def sees_motion(self) -> bool:
        return False


def principal_stretches(equilibrium: Equilibrium) -> tuple[Float[Array, " F"], Float[Array, " F"]]:
    """The larger and the smaller principal stretch of each face, against its actuated rest metric.

    Where they are equal, their difference has no derivative; it is given as zero, which is exact for any smooth
    symmetric function of the two.
    """
    g11, g12, g22 = components(first_form(equilibrium.vertices, equilibrium.mesh))
    rest = components(equilibrium.rest.metric)
    r11, r12, _ = rest
    # In the orthonormal rest frame e1 = u / |u| the tensor C is symmetric, so that its eigenvalues lose no digits.
    shear, rest_det = r12 / r11, determinant(rest)
    c11 = g11 / r11
    c12 = (g12 - shear * g11) / jnp.sqrt(rest_det)
    c22 = (g22 - 2 * shear * g12 + shear**2 * g11) * r11 / rest_det
    larger = root(0.5 * (c11 + c22) + root((0.5 * (c11 - c22)) ** 2 + c12**2))
    return larger, over(root(c11 * c22 - c12**2), larger)
