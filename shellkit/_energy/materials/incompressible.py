"""The stretching energy of rubber: a neo-Hookean solid that keeps its volume, so that it thins where it is stretched.
Its sheet is in plane stress, which fixes the pressure and leaves a function of the metric alone."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._citation.papers import TRELOAR_1975
from ..._geometry.forms import Components, components, determinant
from ..._mesh.mesh import Mesh
from ..._rest import RestShape
from ..base import FormEnergy
from .moduli import check_modulus, inverse


class IncompressibleNeoHookean(FormEnergy):
    r"""Stretching energy of an incompressible neo-Hookean sheet in plane stress.

    $$E = h \sum_f A\, \frac\mu2 \left(\mathrm{tr}\,C + \frac1{\det C} - 3\right), \qquad C = g_r^{-1} g.$$

    The stretch across the sheet is $1/\sqrt{\det C}$: a balloon twice as wide is a quarter as thick. For small strain
    it agrees with [`shellkit.StVenantKirchhoff`][] of Poisson's ratio 1/2 and Young's modulus $3\mu$. It grows without
    bound as a face is crushed. For foams and gels that change their volume use [`shellkit.NeoHookean`][].

    ??? cite "Source"

        L. R. G. Treloar, "The physics of rubber elasticity" (Oxford, 1975), chapter 4: $W = \frac\mu2 (\lambda_1^2 +
        \lambda_2^2 + \lambda_3^2 - 3)$ with $\lambda_1 \lambda_2 \lambda_3 = 1$.
    """

    papers: ClassVar[tuple[str, ...]] = (TRELOAR_1975,)
    shear: Float[Array, "..."]
    form: ClassVar[None] = None
    directors: ClassVar[str] = "average"

    def __init__(self, shear: float | Array):
        """**Arguments:**

        - `shear`: the modulus $\\mu$, in units of pressure; one number or one per face.

        **Raises:** `ValueError`, when a problem is built, for a shape that does not fit the mesh.
        """
        self.shear = jnp.asarray(shear, dtype=float)

    @classmethod
    def from_young(cls, young: float | Array) -> "IncompressibleNeoHookean":
        """From Young's modulus: a third of it. Poisson's ratio is 1/2.

        **Arguments:**

        - `young`: Young's modulus, in units of pressure; one number or one per face.
        """
        return cls(jnp.asarray(young, dtype=float) / 3)

    def check(self, mesh: Mesh) -> None:
        check_modulus("IncompressibleNeoHookean", "shear", self.shear, mesh)

    def element_data(self, mesh: Mesh, rest: RestShape):
        metric = components(rest.metric)
        det = determinant(metric)
        return metric, inverse(metric, det), det, rest.stretching_scale / 4 * jnp.sqrt(det) * self.shear

    def density(self, metric: Components, curvature: Components | None, data) -> Float[Array, " F"]:
        rest, rest_inverse, rest_det, shear = data
        # With e = C - 1, t = tr e and d = det e: tr C + 1 / det C - 3 = (t^2 + t d - d) / det C, which loses no digits
        # at small strain.
        change = tuple(now - then for now, then in zip(metric, rest, strict=True))
        trace = rest_inverse[0] * change[0] + 2 * rest_inverse[1] * change[1] + rest_inverse[2] * change[2]
        det = determinant(change) / rest_det
        return shear * (trace**2 + trace * det - det) * rest_det / determinant(metric)
