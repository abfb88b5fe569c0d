"""The energy of layers that each have a grain of their own: stretching, bending, and the coupling of the two."""

from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._citation.papers import JONES_1999
from ..._geometry.forms import Components, CurvatureForm, components, determinant
from ..._mesh.mesh import Mesh
from ..._rest import RestShape
from ..base import FormEnergy
from .moduli import check_curvature_options, check_modulus
from .orthotropic import OrthotropicModuli


class Ply(eqx.Module):
    """One layer of a [`shellkit.LaminateEnergy`][]: its share of the thickness and its material."""

    thickness: Float[Array, "..."]
    moduli: OrthotropicModuli

    def __init__(
        self,
        angle: float | Array,
        along: float | Array,
        across: float | Array,
        poisson: float | Array,
        shear: float | Array,
        thickness: float | Array = 1.0,
    ):
        r"""**Arguments:**

        - `angle`: of the grain, in radians from the first edge of each face on the mesh. One number or one per face, as
            all here.
        - `along`, `across`: Young's moduli, in units of pressure.
        - `poisson`: the contraction across the grain per stretch along it.
        - `shear`: the shear modulus, in units of pressure.
        - `thickness`: relative to the other plies, whose sum is the thickness of the shell.
        """
        self.thickness = jnp.asarray(thickness, dtype=float)
        self.moduli = OrthotropicModuli(angle, along, across, poisson, shear)

    @classmethod
    def isotropic(cls, young: float | Array, poisson: float | Array, thickness: float | Array = 1.0) -> "Ply":
        """A ply without a grain.

        **Arguments:**

        - `young`: Young's modulus, in units of pressure.
        - `poisson`: Poisson's ratio.
        - `thickness`: relative to the other plies.
        """
        young, poisson = jnp.asarray(young, dtype=float), jnp.asarray(poisson, dtype=float)
        return cls(0.0, young, young, poisson, young / (2 * (1 + poisson)), thickness)


class LaminateEnergy(FormEnergy):
    r"""Energy of plies glued together, each with a grain of its own, by the classical theory of laminates.

    With $e = g - g_r$, $k = b - b_r$ and $C_i$ the plane-stress stiffness of ply $i$,

    $$E = \tfrac18 \sum_f A \left[\langle e, \mathcal A e\rangle + 4 \langle e, \mathcal B k\rangle
    + 4 \langle k, \mathcal D k\rangle\right], \qquad (\mathcal A, \mathcal B, \mathcal D) = \sum_i C_i \int_i (1, z,
    z^2)\,\mathrm dz,$$

    with $z$ from the middle of the shell, which the mesh is. It is the whole elastic energy: add no stretching or
    bending to it. Plies that are not symmetric about the middle couple the two: a cross-ply strip curls when it is
    pulled. All plies share the rest shape; for isotropic layers with rest shapes of their own see
    [`shellkit.Laminate`][].

    ??? cite "Source"

        R. M. Jones, "Mechanics of composite materials" (2nd edition, 1999), equations 4.22–4.24.
    """

    papers: ClassVar[tuple[str, ...]] = (JONES_1999,)
    plies: tuple[Ply, ...]
    form: CurvatureForm = eqx.field(static=True)
    directors: str = eqx.field(static=True)

    def __init__(self, plies: Sequence[Ply], form: CurvatureForm = "sin", directors: str = "average"):
        """**Arguments:**

        - `plies`: from the bottom to the top, the side that the face normals point to.
        - `form`, `directors`: as of [`shellkit.Bending`][].

        **Raises:** `ValueError` without plies, or for an unknown `form` or `directors`; when a problem is built, for
        moduli or thicknesses that do not fit the mesh or are not positive.
        """
        check_curvature_options("LaminateEnergy", form, directors)
        if not plies:
            raise ValueError("LaminateEnergy: there are no plies; give at least one.")
        self.plies = tuple(plies)
        self.form = form
        self.directors = directors

    def check(self, mesh: Mesh) -> None:
        for number, ply in enumerate(self.plies):
            owner = f"LaminateEnergy: ply {number}"
            check_modulus(owner, "thickness", ply.thickness, mesh)
            if not np.all(np.asarray(ply.thickness) > 0):
                raise ValueError(f"{owner}: thickness must be positive everywhere.")
            ply.moduli.check(owner, mesh)

    def element_data(self, mesh: Mesh, rest: RestShape):
        metric = components(rest.metric)
        det = determinant(metric)
        assert rest.curvature is not None  # the problem measures it for every term with a form
        h = rest.thickness
        relative = [jnp.broadcast_to(ply.thickness, h.shape) for ply in self.plies]
        stiffness, below = jnp.zeros((3, 3, 3, *h.shape)), -0.5 * h
        for ply, part in zip(self.plies, relative, strict=True):
            height = h * part / sum(relative)
            middle = below + 0.5 * height
            moments = jnp.stack([height, height * middle, height * (middle**2 + height**2 / 12)])
            stiffness = stiffness + moments[:, None, None] * _in_edge_basis(ply.moduli, mesh, metric, det)
            below = below + height
        return metric, components(rest.curvature), stiffness * jnp.sqrt(det) / 16

    def density(self, metric: Components, curvature: Components, data) -> Float[Array, " F"]:
        rest_metric, rest_curvature, (stretching, coupling, bending) = data
        strain = [now - then for now, then in zip(metric, rest_metric, strict=True)]
        change = [2 * (now - then) for now, then in zip(curvature, rest_curvature, strict=True)]
        return (
            _product(strain, stretching, strain) + 2 * _product(strain, coupling, change)
            + _product(change, bending, change)
        )  # fmt: skip


def _in_edge_basis(moduli: OrthotropicModuli, mesh: Mesh, metric: Components, det: Array) -> Float[Array, "3 3 F"]:
    """The stiffness as a quadratic form in the components 11, 12 and 22 of a strain."""
    d1, d2, n1, n2 = moduli.frame(mesh, metric, det)
    c11, c12, c22, shear = moduli.stiffness()
    along, across = jnp.stack([d1**2, 2 * d1 * d2, d2**2]), jnp.stack([n1**2, 2 * n1 * n2, n2**2])
    mixed = jnp.stack([d1 * n1, d1 * n2 + d2 * n1, d2 * n2])
    outer = lambda a, b: a[:, None] * b[None]
    coupled = outer(along, across) + outer(across, along)
    return c11 * outer(along, along) + c12 * coupled + c22 * outer(across, across) + 4 * shear * outer(mixed, mixed)


def _product(left: list[Array], form: Float[Array, "3 3 F"], right: list[Array]) -> Float[Array, " F"]:
    """Unrolled, so that it stays elementwise."""
    return sum((left[i] * form[i, j] * right[j] for i in range(3) for j in range(3)), jnp.zeros_like(left[0]))
