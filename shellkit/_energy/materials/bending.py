"""Bending energies: of the curvature form of each face, and of the dihedral angle of each edge."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..._citation.papers import CHEN_2018, GRINSPUN_2003, WEISCHEDEL_2012
from ..._geometry.forms import Components, CurvatureForm, components, determinant
from ..._mesh.mesh import Mesh
from ..._rest import RestShape
from ..base import EnergyTerm, FormEnergy
from .moduli import check_curvature_options, check_modulus, invariant_moduli, inverse, lame_halves, quadratic


class Bending(FormEnergy):
    r"""Bending energy quadratic in the change of the curvature form.

    $$E = \frac{h^3}{12} \sum_f A \left[\alpha\, \mathrm{tr}(K)^2 + 2\beta\, \mathrm{tr}(K^2)\right], \qquad K =
    g_r^{-1}(b - b_r).$$

    The bending stiffness of a plate is $D = h^3(\alpha+2\beta)/6$. With `directors="average"` the normal of an edge is
    the mean of its faces' normals, as in the source; on alternating or jittered meshes that does not converge as the
    mesh is refined. With `directors="free"` the normal of each edge may turn about the edge, one more unknown an edge
    and about twice the time on the same mesh, and it converges at second order on any. The default is the source's, so
    that published figures can be had again; take free directors where figures matter.

    ??? cite "Source"

        H.-Y. Chen et al., "Physical simulation of environmentally induced thin shell deformation", ACM Trans. Graph. 37
        (2018), equation 6, with averaged edge normals and `form="sin"`.
    """

    alpha: Float[Array, "..."]
    beta: Float[Array, "..."]
    form: CurvatureForm = eqx.field(static=True)
    directors: str = eqx.field(static=True)

    def __init__(
        self, alpha: float | Array, beta: float | Array, form: CurvatureForm = "sin", directors: str = "average"
    ):
        """**Arguments:**

        - `alpha`, `beta`: half the plane-stress Lamé pair, in units of pressure; one number or one per face.
        - `form`: how a hinge angle enters the curvature: `"sin"` (the source's, which saturates, so that strong
            actuation can fold a hinge flat), `"tan"` (which resists folding without bound) or `"theta"`.
        - `directors`: `"average"` or `"free"` edge normals.

        **Raises:** `ValueError` for an unknown `form` or `directors`; when a problem is built, for moduli whose shape
        does not fit the mesh, or terms that measure curvature in different ways.
        """
        check_curvature_options("Bending", form, directors)
        self.alpha = jnp.asarray(alpha, dtype=float)
        self.beta = jnp.asarray(beta, dtype=float)
        self.form = form
        self.directors = directors

    @classmethod
    def from_young(
        cls,
        young: float | Array,
        poisson: float | Array,
        form: CurvatureForm = "sin",
        directors: str = "average",
    ) -> "Bending":
        """From Young's modulus and Poisson's ratio: alpha = E nu / (2 (1 - nu²)), beta = E / (4 (1 + nu)).

        **Arguments:**

        - `young`: Young's modulus, in units of pressure; one number or one per face.
        - `poisson`: Poisson's ratio; one number or one per face.
        - `form`, `directors`: as above.
        """
        return cls(*lame_halves(young, poisson), form=form, directors=directors)

    @property
    def papers(self) -> tuple[str, ...]:
        """What to cite for it; more with free edge normals."""
        return (CHEN_2018,) if self.directors == "average" else (CHEN_2018, WEISCHEDEL_2012)

    def check(self, mesh: Mesh) -> None:
        check_modulus("Bending", "alpha", self.alpha, mesh)
        check_modulus("Bending", "beta", self.beta, mesh)

    def element_data(self, mesh: Mesh, rest: RestShape):
        metric = components(rest.metric)
        det = determinant(metric)
        scale = rest.bending_scale / 24 * jnp.sqrt(det)
        assert rest.curvature is not None  # the problem measures it for every term with a form
        return (
            components(rest.curvature),
            inverse(metric, det),
            *invariant_moduli(scale * self.alpha, scale * self.beta, det),
        )

    def density(self, metric: Components, curvature: Components, data) -> Float[Array, " F"]:
        rest, rest_inverse, *moduli = data
        change = tuple(now - then for now, then in zip(curvature, rest, strict=True))
        return quadratic(rest_inverse, change, *moduli)


class DihedralBending(EnergyTerm):
    r"""Discrete-shells bending energy of the dihedral angle of each interior edge.

    $$E = \kappa \sum_e \frac{\ell_e^2}{A_e} (\theta_e - \theta_e^0)^2, \qquad A_e = (A_f + A_{f'})/3,$$

    with length and areas of the current shape, which makes it scale invariant. Cheap and robust, but its stiffness
    depends on the triangulation and it knows no Poisson ratio: use [`shellkit.Bending`][] where figures matter.

    ??? cite "Source"

        E. Grinspun et al., "Discrete shells", SCA 2003, equation 2, up to the factor in the area.
    """

    papers: ClassVar[tuple[str, ...]] = (GRINSPUN_2003,)
    stiffness: Float[Array, "..."]
    rest_angles: Float[Array, " E"] | None

    def __init__(self, stiffness: float | Array, rest_angles: Float[Array, " E"] | None = None):
        """**Arguments:**

        - `stiffness`: $\\kappa$, in units of energy; one number or one an edge.
        - `rest_angles`: of every edge of the mesh, in radians; `None` for those of the mesh at rest. Boundary edges
            are passed over. Give zeros for a shell that would like to be flat.
        """
        self.stiffness = jnp.asarray(stiffness, dtype=float)
        self.rest_angles = None if rest_angles is None else jnp.asarray(rest_angles, dtype=float)

    def check(self, mesh: Mesh) -> None:
        if self.stiffness.shape not in ((), (mesh.n_edges,)):
            raise ValueError(
                f"DihedralBending: stiffness has shape {self.stiffness.shape}; give one number or one an edge, shape "
                f"({mesh.n_edges},)."
            )
        if self.rest_angles is not None and self.rest_angles.shape != (mesh.n_edges,):
            raise ValueError(
                f"DihedralBending: rest_angles has shape {self.rest_angles.shape}; expected one angle an edge, "
                f"shape ({mesh.n_edges},)."
            )

    def stencil(self, mesh: Mesh) -> Int[Array, "E 4"]:
        first = mesh.faces[mesh.edge_faces[:, 0], mesh.edge_corners[:, 0]]
        second = mesh.faces[mesh.edge_faces[:, 1], mesh.edge_corners[:, 1]]
        # A boundary edge repeats its one opposite vertex, which keeps its formulas finite; it weighs nothing.
        return jnp.column_stack([mesh.edges, first, jnp.where(mesh.edge_faces[:, 1] >= 0, second, first)])

    def element_data(self, mesh: Mesh, rest: RestShape):
        stiffness = jnp.where(mesh.edge_faces[:, 1] >= 0, self.stiffness, 0.0)
        if self.rest_angles is None:
            return stiffness, _dihedral(jnp.moveaxis(mesh.vertices[self.stencil(mesh)], 0, -1))[0]
        return stiffness, self.rest_angles

    def element_energy(self, x: Float[Array, "4 3"], data) -> Float[Array, ""]:
        stiffness, rest_angle = data
        angle, squared_length, twice_areas = _dihedral(x)
        return stiffness * 6 * squared_length / twice_areas * (angle - rest_angle) ** 2


def _dihedral(x: Float[Array, "4 3 *n"]) -> tuple[Array, Array, Array]:
    """Angle, squared edge length and sum of the double areas, for tail, head and the corners opposite in both faces."""
    edge, near, far = x[1] - x[0], x[2] - x[0], x[3] - x[0]
    cross = lambda a, b: (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    dot = lambda a, b: a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    first, second = cross(edge, near), cross(far, edge)
    squared_length = dot(edge, edge)
    angle = jnp.arctan2(-jnp.sqrt(squared_length) * dot(far, first), dot(first, second))
    return angle, squared_length, jnp.sqrt(dot(first, first)) + jnp.sqrt(dot(second, second))
