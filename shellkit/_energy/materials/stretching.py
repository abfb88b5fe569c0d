"""Stretching energies: functions of the metric of each face against its rest metric."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._citation.papers import CHEN_2018, CLAUSSEN
from ..._geometry.forms import Components, components, determinant
from ..._mesh.mesh import Mesh
from ..._rest import RestShape
from ..base import FormEnergy
from .moduli import check_modulus, invariant_moduli, inverse, lame_halves, quadratic


class StVenantKirchhoff(FormEnergy):
    r"""Stretching energy quadratic in the strain of the metric.

    $$E = \frac h4 \sum_f A \left[\alpha\, \mathrm{tr}(M)^2 + 2\beta\, \mathrm{tr}(M^2)\right], \qquad M = g_r^{-1} g
    - 1,$$

    with the rest area $A = \frac12\sqrt{\det g_r}$. For moderate strain; a face can be crushed to zero area at a
    finite cost, for which [`shellkit.NeoHookean`][] is the better choice.

    ??? cite "Source"

        Koiter's shell energy in the discretisation of H.-Y. Chen et al., "Physical simulation of environmentally
        induced thin shell deformation", ACM Trans. Graph. 37 (2018), equation 6. Their $\alpha$, $\beta$ as here;
        libshell's convention gives half this energy at equal moduli.
    """

    papers: ClassVar[tuple[str, ...]] = (CHEN_2018,)
    alpha: Float[Array, "..."]
    beta: Float[Array, "..."]
    form: ClassVar[None] = None
    directors: ClassVar[str] = "average"

    def __init__(self, alpha: float | Array, beta: float | Array):
        """**Arguments:**

        - `alpha`, `beta`: half the plane-stress Lamé pair, in units of pressure; one number or one per face.

        **Raises:** `ValueError`, when a problem is built, for a shape that does not fit the mesh.
        """
        self.alpha = jnp.asarray(alpha, dtype=float)
        self.beta = jnp.asarray(beta, dtype=float)

    @classmethod
    def from_young(cls, young: float | Array, poisson: float | Array) -> "StVenantKirchhoff":
        """From Young's modulus and Poisson's ratio: alpha = E nu / (2 (1 - nu²)), beta = E / (4 (1 + nu)).

        **Arguments:**

        - `young`: Young's modulus, in units of pressure; one number or one per face.
        - `poisson`: Poisson's ratio; one number or one per face.
        """
        return cls(*lame_halves(young, poisson))

    def check(self, mesh: Mesh) -> None:
        check_modulus("StVenantKirchhoff", "alpha", self.alpha, mesh)
        check_modulus("StVenantKirchhoff", "beta", self.beta, mesh)

    def element_data(self, mesh: Mesh, rest: RestShape):
        metric = components(rest.metric)
        det = determinant(metric)
        scale = rest.stretching_scale / 8 * jnp.sqrt(det)
        return metric, inverse(metric, det), *invariant_moduli(scale * self.alpha, scale * self.beta, det)

    def density(self, metric: Components, curvature: Components | None, data) -> Float[Array, " F"]:
        rest, rest_inverse, *moduli = data
        strain = tuple(now - then for now, then in zip(metric, rest, strict=True))
        return quadratic(rest_inverse, strain, *moduli)


class NeoHookean(FormEnergy):
    r"""Stretching energy that grows without bound as a face is crushed.

    $$E = \frac h4 \sum_f A \left[\frac\mu2\left(\frac{\mathrm{tr}\,C}{\sqrt{\det C}} - 2\right)
    + \frac K2\left(\sqrt{\det C} - 1\right)^2\right], \qquad C = g_r^{-1} g.$$

    For small strain it agrees with [`shellkit.StVenantKirchhoff`][] when $\mu = 8\beta$ and $K = 8(\alpha+\beta)$.

    ??? cite "Source"

        The two-dimensional compressible density of the inverse-design tutorial of `triangulax`, with its own moduli
        1, 1.
    """

    papers: ClassVar[tuple[str, ...]] = (CLAUSSEN,)
    bulk: Float[Array, "..."]
    shear: Float[Array, "..."]
    form: ClassVar[None] = None
    directors: ClassVar[str] = "average"

    def __init__(self, bulk: float | Array, shear: float | Array):
        """**Arguments:**

        - `bulk`, `shear`: $K$ and $\\mu$, in units of pressure; one number or one per face.

        **Raises:** `ValueError`, when a problem is built, for a shape that does not fit the mesh.
        """
        self.bulk = jnp.asarray(bulk, dtype=float)
        self.shear = jnp.asarray(shear, dtype=float)

    @classmethod
    def from_young(cls, young: float | Array, poisson: float | Array) -> "NeoHookean":
        """From Young's modulus and Poisson's ratio: mu = 8 beta, K = 8 (alpha + beta), so that small strains agree.

        **Arguments:**

        - `young`: Young's modulus, in units of pressure; one number or one per face.
        - `poisson`: Poisson's ratio; one number or one per face.
        """
        alpha, beta = lame_halves(young, poisson)
        return cls(bulk=8 * (alpha + beta), shear=8 * beta)

    def check(self, mesh: Mesh) -> None:
        check_modulus("NeoHookean", "bulk", self.bulk, mesh)
        check_modulus("NeoHookean", "shear", self.shear, mesh)

    def element_data(self, mesh: Mesh, rest: RestShape):
        metric = components(rest.metric)
        det = determinant(metric)
        scale = rest.stretching_scale / 16 * jnp.sqrt(det)
        return metric, inverse(metric, det), det, scale * self.bulk, scale * self.shear

    def density(self, metric: Components, curvature: Components | None, data) -> Float[Array, " F"]:
        rest, rest_inverse, rest_det, bulk, shear = data
        stretch = jnp.sqrt(determinant(metric) / rest_det)
        # With e = C - 1: tr C - 2 J = (tr(e)^2 - 4 det e) / (tr C + 2 J) and J - 1 = (tr e + det e) / (J + 1), which
        # lose no digits at small strain.
        change = tuple(now - then for now, then in zip(metric, rest, strict=True))
        trace = rest_inverse[0] * change[0] + 2 * rest_inverse[1] * change[1] + rest_inverse[2] * change[2]
        det = determinant(change) / rest_det
        shearing = (trace**2 - 4 * det) / (stretch * (2 + trace + 2 * stretch))
        return shear * shearing + bulk * ((trace + det) / (stretch + 1)) ** 2
