"""Directors as angles and back: an angle is counted in the plane of a face, from its first edge, on the mesh as it
lies at rest."""

from collections.abc import Sequence

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._mesh.mesh import Mesh
from .rowwise import dot
from .surface import face_frames


def director_angles(mesh: Mesh, direction: ArrayLike | Sequence) -> Float[Array, " F"]:
    r"""Angle of a direction in space, projected on each face: $\theta = \operatorname{atan2}(D \cdot e_2, D \cdot
    e_1)$.

    The frame $(e_1, e_2)$ is that of [`shellkit.face_frames`][] at `mesh.vertices`. Where the direction is normal to
    a face the angle is undefined and given as zero: keep such faces out of a pattern, or expect a defect there.

    **Arguments:**

    - `mesh`: the surface.
    - `direction`: one vector, shape `(3,)`, or one per face, shape `(F, 3)`; only its direction counts.

    **Returns:**

    An array of shape `(F,)`, radians in $[-\pi, \pi]$. A director has no head: $\theta$ and $\theta + \pi$ are the
    same.

    **Raises:**

    `ValueError` for a direction of another shape.
    """
    direction = jnp.asarray(direction, dtype=mesh.vertices.dtype)
    if direction.shape not in ((3,), (mesh.n_faces, 3)):
        raise ValueError(
            f"direction has shape {direction.shape}; give one vector, shape (3,), or one per face, "
            f"shape ({mesh.n_faces}, 3)."
        )
    e1, e2 = face_frames(mesh.vertices, mesh)
    direction = jnp.broadcast_to(direction, e1.shape)
    return jnp.arctan2(dot(direction, e2), dot(direction, e1))


def directors(mesh: Mesh, angles: ArrayLike | Sequence) -> Float[Array, "F 3"]:
    r"""Unit vectors in space, $d = \cos\theta\, e_1 + \sin\theta\, e_2$, on the faces of the mesh as it lies at rest.

    **Arguments:**

    - `mesh`: the surface; its frames are those of [`shellkit.face_frames`][] at `mesh.vertices`.
    - `angles`: one angle per face, shape `(F,)`, radians.

    **Returns:**

    An array of shape `(F, 3)`.

    **Raises:**

    `ValueError` for angles of another shape.
    """
    angles = jnp.asarray(angles, dtype=mesh.vertices.dtype)
    if angles.shape != (mesh.n_faces,):
        raise ValueError(f"angles has shape {angles.shape}; give one angle per face, shape ({mesh.n_faces},).")
    e1, e2 = face_frames(mesh.vertices, mesh)
    return jnp.cos(angles)[:, None] * e1 + jnp.sin(angles)[:, None] * e2
