"""The stretching energy of a membrane that wrinkles instead of bearing compression: the relaxed energy of StVK."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._citation.papers import LE_DRET_1995, PIPKIN_1986, STEIGMANN_1990
from ..._geometry.forms import Components, components, determinant
from ..._mesh.mesh import Mesh
from ..._rest import RestShape
from ..base import FormEnergy
from .moduli import check_modulus, invariant_moduli, inverse, lame_halves, quadratic


class TensionField(FormEnergy):
    r"""Stretching energy of a thin membrane that wrinkles where it would be compressed.

    With $m_1 \ge m_2$ the eigenvalues of $M = g_r^{-1} g - 1$, $\nu = \alpha / (\alpha + 2\beta)$ and $[x]_+ =
    \max(x, 0)$,

    $$E = \frac h4 \sum_f A \left[\frac{4\beta(\alpha+\beta)}{\alpha+2\beta}\, [m_1]_+^2
    + (\alpha+2\beta)\, [m_2 + \nu m_1]_+^2 \right],$$

    the lowest energy that fine wrinkles leave of [`shellkit.StVenantKirchhoff`][]. A face is *taut* where both terms
    act, and then has StVK's energy; *wrinkled* where only the first does, in uniaxial tension along the wrinkles; or
    *slack*, at no cost. The wrinkles themselves are not seen: the surface is their mean. The first derivative is
    continuous, the second jumps where a face goes slack.

    Slack faces resist nothing, so an equilibrium may not be unique. Add a little [`shellkit.Bending`][], or a
    `residual` stiffness, and the relaxation is well posed again.

    ??? cite "Sources"

        A. C. Pipkin, "The relaxed energy density for isotropic elastic membranes", IMA J. Appl. Math. 36 (1986), 85;
        D. J. Steigmann, "Tension-field theory", Proc. R. Soc. A 429 (1990), 141. For StVK in closed form: H. Le Dret
        and A. Raoult, "The nonlinear membrane model as variational limit of nonlinear three-dimensional elasticity", J.
        Math. Pures Appl. 74 (1995), 549.
    """

    papers: ClassVar[tuple[str, ...]] = (
        PIPKIN_1986,
        STEIGMANN_1990,
        LE_DRET_1995,
    )
    alpha: Float[Array, "..."]
    beta: Float[Array, "..."]
    residual: Float[Array, ""]
    form: ClassVar[None] = None
    directors: ClassVar[str] = "average"

    def __init__(self, alpha: float | Array, beta: float | Array, residual: float | Array = 0.0):
        """**Arguments:**

        - `alpha`, `beta`: half the plane-stress Lamé pair, in units of pressure; one number or one per face.
        - `residual`: the part of StVK's energy that is kept whether taut or not, 0 to 1. 1e-3 steadies slack regions.
        """
        self.alpha = jnp.asarray(alpha, dtype=float)
        self.beta = jnp.asarray(beta, dtype=float)
        self.residual = jnp.asarray(residual, dtype=float)

    @classmethod
    def from_young(cls, young: float | Array, poisson: float | Array, residual: float | Array = 0.0) -> "TensionField":
        """From Young's modulus and Poisson's ratio: alpha = E nu / (2 (1 - nu²)), beta = E / (4 (1 + nu)).

        **Arguments:**

        - `young`: Young's modulus, in units of pressure; one number or one per face.
        - `poisson`: Poisson's ratio; one number or one per face.
        - `residual`: as above.
        """
        return cls(*lame_halves(young, poisson), residual=residual)

    def check(self, mesh: Mesh) -> None:
        check_modulus("TensionField", "alpha", self.alpha, mesh)
        check_modulus("TensionField", "beta", self.beta, mesh)

    def element_data(self, mesh: Mesh, rest: RestShape):
        metric = components(rest.metric)
        det = determinant(metric)
        scale = rest.stretching_scale / 8 * jnp.sqrt(det)
        return metric, inverse(metric, det), det, scale * self.alpha, scale * self.beta, self.residual

    def density(self, metric: Components, curvature: Components | None, data) -> Float[Array, " F"]:
        rest, rest_inverse, rest_det, alpha, beta, residual = data
        strain = tuple(now - then for now, then in zip(metric, rest, strict=True))
        full = quadratic(rest_inverse, strain, *invariant_moduli(alpha, beta, rest_det))
        larger, smaller = _eigenvalues(rest, rest_det, strain)
        poisson = alpha / (alpha + 2 * beta)
        uniaxial = 4 * beta * (alpha + beta) / (alpha + 2 * beta) * larger**2
        # A taut face takes the quadratic form, which is smooth where both eigenvalues are equal. In the other two the
        # eigenvalues differ, or the energy is zero.
        relaxed = jnp.where(smaller + poisson * larger > 0, full, jnp.where(larger > 0, uniaxial, 0.0))
        return relaxed + residual * (full - relaxed)


def _eigenvalues(rest: Components, det: Array, strain: Components) -> tuple[Array, Array]:
    """The larger and the smaller eigenvalue of the strain in the rest metric; no derivative where they are equal."""
    r11, r12, _ = rest
    e11, e12, e22 = strain
    # In the orthonormal frame e1 = u / |u| the tensor is symmetric.
    shear = r12 / r11
    m11, m12 = e11 / r11, (e12 - shear * e11) / jnp.sqrt(det)
    m22 = (e22 - 2 * shear * e12 + shear**2 * e11) * r11 / det
    squared = (0.5 * (m11 - m22)) ** 2 + m12**2
    differ = squared > 0
    radius = jnp.where(differ, jnp.sqrt(jnp.where(differ, squared, 1.0)), 0.0)
    mean = 0.5 * (m11 + m22)
    return mean + radius, mean - radius
