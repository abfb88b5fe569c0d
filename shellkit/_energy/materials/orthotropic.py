"""Materials with a grain: quadratic energies of stretching and bending whose stiffness along a direction in each face
differs from that across it, as in paper, wood, cloth and composites."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from ..._citation.papers import JONES_1999
from ..._geometry.forms import Components, CurvatureForm, components, determinant, first_form
from ..._mesh.mesh import Mesh
from ..._rest import RestShape
from ..base import FormEnergy
from .moduli import check_curvature_options, check_modulus


class OrthotropicModuli(eqx.Module):
    """Engineering constants of a sheet with a grain, and the direction of the grain in each face."""

    angle: Float[Array, "..."]
    along: Float[Array, "..."]
    across: Float[Array, "..."]
    poisson: Float[Array, "..."]
    shear: Float[Array, "..."]

    def __init__(self, angle, along, across, poisson, shear):
        self.angle = jnp.asarray(angle, dtype=float)
        self.along = jnp.asarray(along, dtype=float)
        self.across = jnp.asarray(across, dtype=float)
        self.poisson = jnp.asarray(poisson, dtype=float)
        self.shear = jnp.asarray(shear, dtype=float)

    def check(self, owner: str, mesh: Mesh) -> None:
        """Refuse constants that do not fit the mesh, or that make a sheet which collapses by itself."""
        values = {"angle": self.angle, "along": self.along, "across": self.across, "poisson": self.poisson}
        values["shear"] = self.shear
        for name, value in values.items():
            check_modulus(owner, name, value, mesh)
        if any(isinstance(value, Tracer) for value in values.values()):
            return
        along, across, poisson, shear = (np.asarray(values[n]) for n in ("along", "across", "poisson", "shear"))
        if not (np.all(along > 0) and np.all(across > 0) and np.all(shear > 0)):
            raise ValueError(f"{owner}: along, across and shear must be positive everywhere.")
        if not np.all(poisson**2 * across < along):
            raise ValueError(
                f"{owner}: poisson² · across must stay below along everywhere (poisson is the contraction across when "
                "pulled along); otherwise some strain costs less than nothing."
            )

    def stiffness(self) -> tuple[Array, Array, Array, Array]:
        """Plane stress per strain: 1111, 1122, 2222 and the shear modulus."""
        single = 1 - self.poisson**2 * self.across / self.along
        return self.along / single, self.poisson * self.across / single, self.across / single, self.shear

    def frame(self, mesh: Mesh, rest: Components, det: Array) -> tuple[Array, Array, Array, Array]:
        """The grain and the direction across it in the edge basis of each face, orthonormal in the rest metric.

        The grain is a line of the material: its angle is that on the mesh, and an actuation carries it along.
        """
        g11, g12, g22 = components(first_form(mesh.vertices, mesh))
        height = jnp.sqrt(g11 * g22 - g12**2)
        d1 = (jnp.cos(self.angle) - g12 / height * jnp.sin(self.angle)) / jnp.sqrt(g11)
        d2 = jnp.sqrt(g11) / height * jnp.sin(self.angle)
        size = jnp.sqrt(rest[0] * d1**2 + 2 * rest[1] * d1 * d2 + rest[2] * d2**2)
        d1, d2 = d1 / size, d2 / size
        root = jnp.sqrt(det)
        return d1, d2, -(rest[1] * d1 + rest[2] * d2) / root, (rest[0] * d1 + rest[1] * d2) / root


def _quadratic(frame: tuple[Array, ...], strain: Components, stiffness: tuple[Array, ...]) -> Float[Array, " F"]:
    """c11 m11^2 + 2 c12 m11 m22 + c22 m22^2 + 4 G m12^2 of a strain in the frame of the grain."""
    d1, d2, n1, n2 = frame
    c11, c12, c22, shear = stiffness
    along_1, along_2 = strain[0] * d1 + strain[1] * d2, strain[1] * d1 + strain[2] * d2
    m11, m12 = along_1 * d1 + along_2 * d2, along_1 * n1 + along_2 * n2
    m22 = strain[0] * n1**2 + 2 * strain[1] * n1 * n2 + strain[2] * n2**2
    return c11 * m11**2 + 2 * c12 * m11 * m22 + c22 * m22**2 + 4 * shear * m12**2


class OrthotropicStretching(FormEnergy):
    r"""Stretching energy of a sheet with a grain, quadratic in the strain of the metric.

    $$E = \frac h8 \sum_f A \left[C_{11} M_{11}^2 + 2 C_{12} M_{11} M_{22} + C_{22} M_{22}^2 + 4 G M_{12}^2\right],
    \qquad M = g_r^{-1} g - 1,$$

    with $M$ in the orthonormal frame along and across the grain, $C_{11} = E_1/(1 - \nu_{12}\nu_{21})$, $C_{22} =
    E_2/(1 - \nu_{12}\nu_{21})$, $C_{12} = \nu_{12} C_{22}$ and $\nu_{21} = \nu_{12} E_2/E_1$. With $E_1 = E_2$ and $G =
    E/2(1+\nu)$ it is [`shellkit.StVenantKirchhoff`][]. For moderate strain. It stretches only: add
    [`shellkit.OrthotropicBending`][] with the same constants.

    ??? cite "Source"

        R. M. Jones, "Mechanics of composite materials" (2nd edition, 1999), equations 2.61–2.66, with Green's strain.
    """

    papers: ClassVar[tuple[str, ...]] = (JONES_1999,)
    moduli: OrthotropicModuli
    form: ClassVar[None] = None
    directors: ClassVar[str] = "average"

    def __init__(
        self,
        angle: float | Array,
        along: float | Array,
        across: float | Array,
        poisson: float | Array,
        shear: float | Array,
    ):
        r"""**Arguments:**

        - `angle`: of the grain, in radians from the first edge of each face on the mesh; see
            [`shellkit.director_angles`][]. One number or one per face, as all here.
        - `along`, `across`: Young's moduli $E_1$ and $E_2$, in units of pressure.
        - `poisson`: $\nu_{12}$, the contraction across the grain per stretch along it.
        - `shear`: the modulus $G$, in units of pressure.
        """
        self.moduli = OrthotropicModuli(angle, along, across, poisson, shear)

    def check(self, mesh: Mesh) -> None:
        self.moduli.check("OrthotropicStretching", mesh)

    def element_data(self, mesh: Mesh, rest: RestShape):
        metric = components(rest.metric)
        det = determinant(metric)
        scale = rest.stretching_scale / 16 * jnp.sqrt(det)
        return metric, self.moduli.frame(mesh, metric, det), tuple(scale * c for c in self.moduli.stiffness())

    def density(self, metric: Components, curvature: Components | None, data) -> Float[Array, " F"]:
        rest, frame, stiffness = data
        strain = (metric[0] - rest[0], metric[1] - rest[1], metric[2] - rest[2])
        return _quadratic(frame, strain, stiffness)


class OrthotropicBending(FormEnergy):
    r"""Bending energy of a sheet with a grain, quadratic in the change of the curvature form.

    $$E = \frac{h^3}{24} \sum_f A \left[C_{11} K_{11}^2 + 2 C_{12} K_{11} K_{22} + C_{22} K_{22}^2 + 4 G
    K_{12}^2\right], \qquad K = g_r^{-1} (b - b_r),$$

    with $K$ in the frame of the grain and the constants as in [`shellkit.OrthotropicStretching`][]. The grain runs
    through the whole thickness; for layers with grains of their own see [`shellkit.LaminateEnergy`][].

    ??? cite "Source"

        R. M. Jones, "Mechanics of composite materials" (2nd edition, 1999), section 4.2.
    """

    papers: ClassVar[tuple[str, ...]] = (JONES_1999,)
    moduli: OrthotropicModuli
    form: CurvatureForm = eqx.field(static=True)
    directors: str = eqx.field(static=True)

    def __init__(
        self,
        angle: float | Array,
        along: float | Array,
        across: float | Array,
        poisson: float | Array,
        shear: float | Array,
        form: CurvatureForm = "sin",
        directors: str = "average",
    ):
        r"""**Arguments:**

        - `angle`: of the grain, in radians from the first edge of each face on the mesh. One number or one per face, as
            all of the constants.
        - `along`, `across`: Young's moduli $E_1$ and $E_2$, in units of pressure.
        - `poisson`: $\nu_{12}$, the contraction across the grain per stretch along it.
        - `shear`: the modulus $G$, in units of pressure.
        - `form`, `directors`: as of [`shellkit.Bending`][].
        """
        check_curvature_options("OrthotropicBending", form, directors)
        self.moduli = OrthotropicModuli(angle, along, across, poisson, shear)
        self.form = form
        self.directors = directors

    def check(self, mesh: Mesh) -> None:
        self.moduli.check("OrthotropicBending", mesh)

    def element_data(self, mesh: Mesh, rest: RestShape):
        metric = components(rest.metric)
        det = determinant(metric)
        scale = rest.bending_scale / 48 * jnp.sqrt(det)
        assert rest.curvature is not None  # the problem measures it for every term with a form
        frame = self.moduli.frame(mesh, metric, det)
        return components(rest.curvature), frame, tuple(scale * c for c in self.moduli.stiffness())

    def density(self, metric: Components, curvature: Components, data) -> Float[Array, " F"]:
        rest, frame, stiffness = data
        change = (curvature[0] - rest[0], curvature[1] - rest[1], curvature[2] - rest[2])
        return _quadratic(frame, change, stiffness)
