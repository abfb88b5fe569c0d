"""The first and second fundamental forms of a face, from its squared edge lengths and half hinge angles.

A face (a, b, c) has six intrinsic numbers: the squared lengths of the edges opposite a, b and c, and the half angles
between its normal and the normals of those edges. Both forms are functions of them alone.
"""

from collections.abc import Callable
from typing import Literal, TypeAlias

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._mesh.mesh import Mesh
from .patches import ClampedSide, Hinges, Triangles


Components: TypeAlias = tuple[Array, Array, Array]
"""Components 11, 12 and 22 of symmetric 2x2 forms, in the basis u = b - a, v = c - a of each face."""

CurvatureForm: TypeAlias = Literal["sin", "tan", "theta"]

BEND: dict[str, Callable[[Array], Array]] = {"sin": jnp.sin, "tan": jnp.tan, "theta": lambda half_angle: half_angle}
BEND_SLOPES: dict[str, Callable[[Array], tuple[Array, Array]]] = {
    "sin": lambda half_angle: (jnp.cos(half_angle), -jnp.sin(half_angle)),
    "tan": lambda half_angle: (1 + jnp.tan(half_angle) ** 2, 2 * jnp.tan(half_angle) * (1 + jnp.tan(half_angle) ** 2)),
    "theta": lambda half_angle: (jnp.ones_like(half_angle), jnp.zeros_like(half_angle)),
}
"""First and second derivatives of `BEND`."""


def metric_from_lengths(squared_lengths: Float[Array, "3 F"] | Components) -> Components:
    """The metric of every face from its squared edge lengths."""
    opposite_a, opposite_b, opposite_c = squared_lengths
    return opposite_c, 0.5 * (opposite_b + opposite_c - opposite_a), opposite_b


def determinant(form: Components) -> Array:
    """The determinant of symmetric 2x2 forms."""
    return form[0] * form[2] - form[1] * form[1]


def components(form: Float[Array, "F 2 2"]) -> Components:
    """The three components of symmetric 2x2 forms."""
    return form[:, 0, 0], 0.5 * (form[:, 0, 1] + form[:, 1, 0]), form[:, 1, 1]


def matrices(form: Components) -> Float[Array, "F 2 2"]:
    """Symmetric 2x2 forms from their three components."""
    return jnp.stack([jnp.stack([form[0], form[1]], axis=-1), jnp.stack([form[1], form[2]], axis=-1)], axis=-2)


def curvature_from_angles(
    squared_lengths: Float[Array, "3 F"],
    twice_area: Float[Array, " F"],
    half_angles: Float[Array, "3 F"],
    form: CurvatureForm,
) -> Components:
    """The curvature form of every face: edge i adds its height times the sine (tangent, angle) of its half angle."""
    return curvature_from_bends(2.0 * twice_area / jnp.sqrt(squared_lengths) * BEND[form](half_angles))


def curvature_from_bends(bends: Float[Array, "3 F"] | tuple[Array, Array, Array]) -> Components:
    """The curvature form of every face from what each of its edges adds to it."""
    sa, sb, sc = bends
    return sa + sb, sa, sa + sc


def director_signs(mesh: Mesh) -> Float[Array, "3 F"]:
    """+1 where a face is the first of edge i, -1 where it is the second: how the face sees the edge's director."""
    first = mesh.edge_faces[mesh.face_edges, 0] == jnp.arange(mesh.n_faces, dtype=mesh.faces.dtype)[:, None]
    return jnp.where(first, 1.0, -1.0).T.astype(mesh.vertices.dtype)


def half_angles(
    vertices: Float[Array, "V 3"],
    mesh: Mesh,
    triangles: Triangles,
    directors: Float[Array, " E"] | None,
    continuation: ClampedSide | None = None,
) -> Float[Array, "3 F"]:
    """Angles between the normal of every face and the normals of its three edges."""
    hinges = Hinges(vertices, mesh, triangles, continuation)
    half = hinges.near_part(hinges.angles)
    if directors is None:
        return half
    return half + director_signs(mesh) * directors[mesh.face_edges.T]


def first_form(vertices: Float[Array, "V 3"], mesh: Mesh) -> Float[Array, "F 2 2"]:
    """The metric [[u.u, u.v], [u.v, v.v]] of every face (a, b, c), with u = b - a and v = c - a.

    **Arguments:**

    - `vertices`: positions at which to measure, shape `(V, 3)`; need not be `mesh.vertices`.
    - `mesh`: the connectivity.

    **Returns:**

    An array of shape `(F, 2, 2)`, in the square of the vertices' unit.
    """
    return matrices(metric_from_lengths(Triangles(vertices, mesh).squared_lengths))


def second_form(
    vertices: Float[Array, "V 3"],
    mesh: Mesh,
    form: CurvatureForm = "sin",
    directors: Float[Array, " E"] | None = None,
) -> Float[Array, "F 2 2"]:
    r"""The curvature form of every face, in the basis u, v; a sphere with outward normals has b = +g.

    With $\omega_i$ the angle between the normal of the face and that of edge $i$, and $s_i = h_i \sin\omega_i$ with
    the height $h_i$ over the edge, $b = 2 [[s_a + s_b, s_a], [s_a, s_a + s_c]]$. Without `directors`, $\omega_i$ is
    half the hinge angle, and this is Chen et al., "Physical simulation of environmentally induced thin shell
    deformation" (ACM Trans. Graph. 37, 2018), section 4; `directors` turn the normal of each edge about the edge
    (Weischedel, "A discrete geometric view on shear-deformable shell models", 2012).

    **Arguments:**

    - `vertices`: positions at which to measure, shape `(V, 3)`; need not be `mesh.vertices`.
    - `mesh`: the connectivity. The normal of a boundary edge is that of its face, unless its director turns it.
    - `form`: `"sin"` as in the source; `"tan"` grows without bound as a hinge folds; `"theta"` is the angle itself.
    - `directors`: angle by which each edge normal is turned, shape `(E,)`, in radians.

    **Returns:**

    An array of shape `(F, 2, 2)`, in the vertices' unit: over the metric it is a curvature.
    """
    triangles = Triangles(vertices, mesh)
    angles = half_angles(vertices, mesh, triangles, directors)
    return matrices(curvature_from_angles(triangles.squared_lengths, triangles.twice_area, angles, form))
