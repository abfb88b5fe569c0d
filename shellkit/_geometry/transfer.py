"""Fields of faces carried from one mesh to another, such as from a coarse mesh to a fine one."""

from collections.abc import Sequence

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._mesh.mesh import Mesh
from .closest import closest_points, interpolate
from .directors import directors
from .surface import face_areas, face_frames, vertex_normals


_FLAT = 1e-6  # of the spread of the faces around a vertex: slopes told by less are taken as zero


def transfer_directors(
    source: Mesh, angles: ArrayLike | Sequence, target: Mesh, smooth: bool = True
) -> Float[Array, " F"]:
    r"""Director angles on one mesh from those on another that lies on, or near, the same surface.

    Each face of the target takes the director at the point of the source that is nearest to its centroid. Directors
    are carried as tensors $Q = d \otimes d$ in space, never as angles: an angle is counted from another edge on another
    mesh, and has no head. $Q$ is projected on the plane of the new face, and its larger principal direction taken.

    For a mesh and its own [`shellkit.Mesh.refine`][] with `smooth=False`, the angles stay exactly what they are on
    face data.

    **Arguments:**

    - `source`: the mesh that the directors are on; its place is that of `source.vertices`.
    - `angles`: one per face of the source, shape `(F_source,)`, radians from its first edge; see
        [`shellkit.director_angles`][].
    - `target`: the mesh to carry them to.
    - `smooth`: whether $Q$ is brought onto the vertices and interpolated, which is of second order in the size of the
        faces. This rounds the steps between coarse faces, and blurs defects over one of them; without it, each new face
        takes the director of the nearest one.

    **Returns:**

    Angles on the target, shape `(F_target,)`, in $[-\pi/2, \pi/2]$. Differentiable in the given ones; undefined, and
    given as some number, where the average has no direction, at the heart of a defect.

    **Raises:**

    `ValueError` for angles that do not fit the source.

    ??? cite "Source"

        The order parameter $Q$: P. G. de Gennes and J. Prost, "The physics of liquid crystals" (2nd edition, 1993),
        section 2.1.
    """
    direction = directors(source, angles)
    tensors = (direction[:, :, None] * direction[:, None, :]).reshape(-1, 9)
    here = transfer_face_values(source, tensors, target, smooth).reshape(-1, 3, 3)
    e1, e2 = face_frames(target.vertices, target)
    q11, q12, q22 = (jnp.einsum("fi,fij,fj->f", a, here, b) for a, b in ((e1, e1), (e1, e2), (e2, e2)))
    return 0.5 * jnp.arctan2(2 * q12, q11 - q22)


def transfer_face_values(
    source: Mesh, values: ArrayLike | Sequence, target: Mesh, smooth: bool = True
) -> Float[Array, "F *k"]:
    """Face data on one mesh from those on another that lies on, or near, the same surface: numbers such as stretches.

    For what refers to the edges of a face, a director or a form, this is not meant: see
    [`shellkit.transfer_directors`][].

    **Arguments:**

    - `source`: the mesh that the values are on.
    - `values`: one row per face of the source, shape `(F_source, ...)`.
    - `target`: the mesh to carry them to.
    - `smooth`: whether the values are brought onto the vertices, each by the linear function that fits the faces around
        it best, and interpolated at the point nearest to the centroid of each new face. This is of second order in the
        size of the faces, and can leave the range of the values by as much. If not, the value of the nearest face is
        taken.

    **Returns:**

    An array of shape `(F_target, ...)`, linear in the values.

    **Raises:**

    `ValueError` for values that do not fit the source.
    """
    values = jnp.asarray(values, dtype=float)
    if values.ndim < 1 or values.shape[0] != source.n_faces:
        raise ValueError(
            f"transfer: the values have shape {values.shape}, but the source mesh has {source.n_faces} faces; give one "
            "row for each."
        )
    centroids = jnp.mean(target.vertices[target.faces], axis=1)
    closest = closest_points(centroids, source.vertices, source.faces)
    if not smooth:
        return values[closest.faces]
    on_vertices = _on_vertices(source, values.reshape(source.n_faces, -1))
    return interpolate(on_vertices, source.faces, closest.faces, closest.weights).reshape(-1, *values.shape[1:])


def _on_vertices(mesh: Mesh, rows: Float[Array, "F k"]) -> Float[Array, "V k"]:
    """Values at the vertices of the linear functions that fit those at the centroids around, weighted by area.

    An average by area alone is of first order: the centroids around a vertex of an uneven mesh do not have their mean
    there.
    """
    areas, faces = face_areas(mesh.vertices, mesh), mesh.faces
    normals = vertex_normals(mesh.vertices, mesh)
    # Where the centroids lie, seen from each corner, in its tangent plane; index-last in the corners.
    arms = jnp.mean(mesh.vertices[faces], axis=1)[:, None] - mesh.vertices[faces]
    normals_here = normals[faces]
    arms = arms - jnp.sum(arms * normals_here, axis=2, keepdims=True) * normals_here

    def gather(per_corner: Array) -> Array:
        weighted = areas[:, None, *([None] * (per_corner.ndim - 2))] * per_corner
        return jnp.zeros((mesh.n_vertices, *per_corner.shape[2:]), per_corner.dtype).at[faces].add(weighted)

    second = gather(arms[..., :, None] * arms[..., None, :])
    size = jnp.trace(second, axis1=1, axis2=2)[:, None, None]
    size = jnp.where(size > 0, size, 1.0)
    # Across the tangent plane, and in it where too few faces are there to tell a slope, the function is constant.
    across = normals[:, :, None] * normals[:, None, :]
    lean = jnp.linalg.solve(second + size * (across + _FLAT * jnp.eye(3)), gather(arms)[..., None])[..., 0]
    shares = 1 - jnp.sum(arms * lean[faces], axis=2)
    totals = gather(shares)
    return gather(shares[..., None] * rows[:, None, :]) / totals[:, None]
