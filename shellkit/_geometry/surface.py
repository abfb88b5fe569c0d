"""What a triangulated surface measures: normals, areas, frames and the enclosed volume, as functions of where the
vertices are. All are smooth in the vertices, forwards and backwards, and stay finite on faces of zero area."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Scalar

from .._mesh.mesh import Mesh
from .rowwise import dot, length, unit


def edge_vectors(vertices: Float[Array, "V 3"], mesh: Mesh) -> tuple[Float[Array, "F 3"], Float[Array, "F 3"]]:
    """The two edge vectors $u = b - a$, $v = c - a$ of each face $(a, b, c)$."""
    a, b, c = (vertices[mesh.faces[:, corner]] for corner in range(3))
    return b - a, c - a


def edge_lengths(vertices: Float[Array, "V 3"], mesh: Mesh) -> Float[Array, " E"]:
    """Length of each edge of `mesh.edges`.

    **Arguments:**

    - `vertices`: positions of the mesh's vertices, shape `(V, 3)`; need not be `mesh.vertices`.
    - `mesh`: the connectivity.

    **Returns:**

    An array of shape `(E,)`, in the unit of the vertices.
    """
    return length(vertices[mesh.edges[:, 1]] - vertices[mesh.edges[:, 0]])


def face_normals(vertices: Float[Array, "V 3"], mesh: Mesh) -> Float[Array, "F 3"]:
    r"""Unit normal of each face, $n = u \times v / |u \times v|$: outward if the faces run anticlockwise seen from
    outside.

    **Arguments:**

    - `vertices`: positions of the mesh's vertices, shape `(V, 3)`; need not be `mesh.vertices`.
    - `mesh`: the connectivity.

    **Returns:**

    An array of shape `(F, 3)`. The normal of a face of zero area is zero.
    """
    u, v = edge_vectors(vertices, mesh)
    return unit(jnp.cross(u, v))


def vertex_normals(vertices: Float[Array, "V 3"], mesh: Mesh) -> Float[Array, "V 3"]:
    """Unit normal of each vertex: the normals of its faces, weighted by area. Zero where these cancel."""
    u, v = edge_vectors(vertices, mesh)
    doubled = jnp.cross(u, v)
    total = jnp.zeros_like(vertices)
    for corner in range(3):
        total = total.at[mesh.faces[:, corner]].add(doubled)
    return unit(total)


def face_areas(vertices: Float[Array, "V 3"], mesh: Mesh) -> Float[Array, " F"]:
    r"""Area of each face, $\tfrac12 |u \times v|$.

    **Arguments:**

    - `vertices`: positions of the mesh's vertices, shape `(V, 3)`; need not be `mesh.vertices`.
    - `mesh`: the connectivity.

    **Returns:**

    An array of shape `(F,)`, in the square of the vertices' unit.
    """
    u, v = edge_vectors(vertices, mesh)
    return 0.5 * length(jnp.cross(u, v))


def face_frames(vertices: Float[Array, "V 3"], mesh: Mesh) -> tuple[Float[Array, "F 3"], Float[Array, "F 3"]]:
    r"""The orthonormal frame of each face in which director angles are counted.

    $e_1 = u / |u|$ runs along the face's first edge, from its first corner to its second, and $e_2 = n \times e_1$
    completes a right-handed frame with the normal $n$. A frame therefore depends on which corner of a face comes
    first.

    **Arguments:**

    - `vertices`: positions of the mesh's vertices, shape `(V, 3)`; need not be `mesh.vertices`.
    - `mesh`: the connectivity.

    **Returns:**

    The pair `(e1, e2)`, each of shape `(F, 3)`.
    """
    u, v = edge_vectors(vertices, mesh)
    e1 = unit(u)
    return e1, unit(v - dot(v, e1)[:, None] * e1)


def vertex_areas(vertices: Float[Array, "V 3"], mesh: Mesh) -> Float[Array, " V"]:
    """Barycentric area of each vertex: a third of the area of the faces around it. They sum to the surface's area.

    **Arguments:**

    - `vertices`: positions of the mesh's vertices, shape `(V, 3)`; need not be `mesh.vertices`.
    - `mesh`: the connectivity.

    **Returns:**

    An array of shape `(V,)`, in the square of the vertices' unit.
    """
    thirds = face_areas(vertices, mesh) / 3
    return corners_to_vertices(jnp.broadcast_to(thirds[:, None], mesh.faces.shape), vertices, mesh)


def surface_area(vertices: Float[Array, "V 3"], mesh: Mesh) -> Scalar:
    """Total area of the surface.

    **Arguments:**

    - `vertices`: positions of the mesh's vertices, shape `(V, 3)`; need not be `mesh.vertices`.
    - `mesh`: the connectivity.

    **Returns:**

    A scalar, in the square of the vertices' unit.
    """
    return jnp.sum(face_areas(vertices, mesh))


def enclosed_volume(vertices: Float[Array, "V 3"], mesh: Mesh) -> Scalar:
    r"""Volume inside a closed surface, $\tfrac16 \sum_f a \cdot (b \times c)$; positive if the normals point outwards.

    Not for open surfaces: there, the value is that of the cone over the surface from the mean of its vertices.

    **Arguments:**

    - `vertices`: positions of the mesh's vertices, shape `(V, 3)`; need not be `mesh.vertices`.
    - `mesh`: the connectivity.

    **Returns:**

    A scalar, in the cube of the vertices' unit.
    """
    # Counted from the mean vertex, so that a shape far from the origin loses no digits.
    centred = vertices - jnp.mean(vertices, axis=0)
    a, b, c = (centred[mesh.faces[:, corner]] for corner in range(3))
    return jnp.sum(dot(a, jnp.cross(b, c))) / 6


def corners_to_vertices(values: Float[Array, "F 3"], vertices: Float[Array, "V 3"], mesh: Mesh) -> Float[Array, " V"]:
    """Sum a number given for each corner of each face over the corners that meet in a vertex."""
    return jax.ops.segment_sum(values.ravel(), mesh.faces.ravel(), num_segments=vertices.shape[0])
