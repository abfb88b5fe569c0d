"""Frames of faces that have moved, in numpy, and directors carried along with the material of their faces."""

import numpy as np
from jaxtyping import Float

from .._mesh.mesh import Mesh


def edge_vectors(
    points: Float[np.ndarray, "V 3"], mesh: Mesh
) -> tuple[Float[np.ndarray, "F 3"], Float[np.ndarray, "F 3"]]:
    """The edge vectors u = b - a and v = c - a of each face (a, b, c), with the vertices at some points."""
    a, b, c = (points[np.asarray(mesh.faces)[:, corner]] for corner in range(3))
    return b - a, c - a


def carried_directors(mesh: Mesh, points: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Directors given by their angles at rest, carried along with the material of each face to where the vertices are
    now; unit vectors, shape `(F, 3)`.

    At rest d = x u + y v in the edge vectors u, v of the face; now it is along x u' + y v' in those of now.
    """
    u, v = edge_vectors(np.asarray(mesh.vertices), mesh)
    length = np.linalg.norm(u, axis=1)
    shift = np.sum(u * v, axis=1) / length
    height = np.linalg.norm(np.cross(u, v), axis=1) / length
    y = np.sin(angles) / height
    x = (np.cos(angles) - y * shift) / length
    u, v = edge_vectors(points, mesh)
    carried = x[:, None] * u + y[:, None] * v
    return carried / np.linalg.norm(carried, axis=1, keepdims=True)
