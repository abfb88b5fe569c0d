"""The distance between surfaces of different connectivity, from the points of one to the nearest ones of the other."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

from .._actuation.base import Actuation
from .._align.aligners import Aligner
from .._align.icp import ICP
from .._citation.papers import BESL_1992
from .._equilibrium import Equilibrium
from .._geometry.closest import closest_points, interpolate
from .._geometry.rowwise import unit
from .._geometry.surface import vertex_areas, vertex_normals
from .._mesh.mesh import Mesh
from .base import LeastSquaresLoss


class PointToSurface(LeastSquaresLoss):
    r"""Mean squared distance between the relaxed surface and a target of any connectivity.

    $$\sum_i w_i\, |x_i - P_T(x_i)|^2, \qquad\text{and both ways}\qquad \tfrac12 \sum_i w_i\, |x_i - P_T(x_i)|^2 +
    \tfrac12 \sum_j w_j\, |t_j - P_S(t_j)|^2,$$

    with $P$ the nearest point of a surface, over the vertices $x_i$ of the relaxed surface $S$ and $t_j$ of the target
    $T$; the weights are their barycentric areas at rest, summing to one. One way only, the relaxed surface may leave
    parts of the target uncovered, or be a part of it on purpose. With `normals`, each squared distance is joined by
    $\ell^2 |n - n'|^2$ of the unit normals at both points, averaged over vertices and interpolated: it tells the two
    sides of a thin part from each other.

    The nearest triangles are searched on the host, exactly; from there on all is differentiated as it stands. The
    loss has a continuous gradient, except where a vertex is equally near to two points of the other surface (its medial
    axis): there it has a kink, downwards. The second derivatives, and with `normals` the first, jump where a nearest
    point passes over an edge. From far away it pulls each point to the nearest part, not to the right one: go from
    coarse to fine, or begin with a [`shellkit.Varifold`][] of large width.

    **Arguments:**

    - `target`: the surface wanted.
    - `both_ways`: whether the target's vertices are measured to the relaxed surface as well.
    - `normals`: the length $\ell$ that a difference of normals of one counts as, in the vertices' unit; `None` for
        none.
    - `aligner`: how the relaxed vertices are laid upon the target; by default `ICP(target.faces)`.

    **Returns:**

    When called, a scalar in the square of the vertices' unit.

    **Raises:**

    `ValueError` for `normals` that is not one number; when checked, for an aligner that does not fit.

    ??? cite

        P. J. Besl and N. D. McKay, "A method for registration of 3-D shapes", IEEE Transactions on Pattern Analysis
        and Machine Intelligence 14 (1992), 239, for the distance; its derivative is that of the squared distance
        function, $2 (x - P(x))$.
    """

    papers: ClassVar[tuple[str, ...]] = (BESL_1992,)

    target: Mesh
    both_ways: bool = eqx.field(static=True)
    normals: Float[Array, ""] | None
    aligner: Aligner

    def __init__(
        self,
        target: Mesh,
        both_ways: bool = True,
        normals: ArrayLike | None = None,
        aligner: Aligner | None = None,
    ):
        self.target = checked_target("PointToSurface", target)
        self.both_ways = both_ways
        self.normals = None if normals is None else jnp.asarray(normals, dtype=float)
        self.aligner = ICP(target.faces) if aligner is None else aligner
        if self.normals is not None:
            if self.normals.shape != ():
                raise ValueError(f"PointToSurface: normals has shape {self.normals.shape}; give one length, shape ().")
            if not isinstance(self.normals, Tracer) and not 0 <= float(self.normals) < float("inf"):
                raise ValueError(f"PointToSurface: normals is {self.normals}; give a length, finite and not negative.")

    def residuals(self, equilibrium: Equilibrium, actuation: Actuation) -> Float[Array, " m"]:
        mesh, target = equilibrium.mesh, self.target
        vertices = self.aligner(equilibrium.vertices, target.vertices)
        there = self._from(mesh, mesh.vertices, vertices, target, target.vertices)
        if not self.both_ways:
            return there
        back = self._from(target, target.vertices, target.vertices, mesh, vertices)
        return jnp.concatenate([there, back]) * 0.5**0.5

    def _from(self, mesh: Mesh, rest: Array, points: Array, other: Mesh, vertices: Array) -> Float[Array, " m"]:
        """Weighted differences of the vertices of a mesh, where they are, from the nearest points of another."""
        areas = vertex_areas(rest, mesh)
        root_share = jnp.sqrt(areas / jnp.sum(areas))[:, None]
        closest = closest_points(points, vertices, other.faces)
        apart = (root_share * (points - closest.points)).ravel()
        if self.normals is None:
            return apart
        normals = unit(interpolate(vertex_normals(vertices, other), other.faces, closest.faces, closest.weights))
        turned = self.normals * root_share * (vertex_normals(points, mesh) - normals)
        return jnp.concatenate([apart, turned.ravel()])

    def check(self, mesh: Mesh, actuation: Actuation) -> None:
        jax.eval_shape(lambda: self.aligner(mesh.vertices, self.target.vertices))

    @property
    def sees_motion(self) -> bool:
        return not self.aligner.removes_motion


def checked_target(what: str, target: Mesh) -> Mesh:
    """The target, if it is a mesh."""
    if not isinstance(target, Mesh):
        raise ValueError(
            f"{what}: target is a {type(target).__name__}; give a Mesh, such as Mesh.read(path) or "
            "mesh.with_vertices(positions)."
        )
    return target
