"""The directors of each layer as short lines on a surface that has moved: a director is drawn along the same material
line of its face as at rest."""

import numpy as np

from .._fields.carried import carried_directors, edge_vectors
from .._mesh.mesh import Mesh


# Where there are more faces, only so many of them show their line, which is longer then.
_MOST_LINES = 3000


def director_lines(
    mesh: Mesh, points: np.ndarray, angles: np.ndarray, level: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """The ends of the lines of one layer, each of shape `(n, 3)`, and the radius they are to be drawn with.

    Lines stay within the circle inscribed in their face; those of `level` 2 lie above those of level 1.
    """
    faces = np.asarray(mesh.faces)
    u, v = edge_vectors(points, mesh)
    sides = [np.linalg.norm(w, axis=1) for w in (u, v, v - u)]
    perimeter = np.maximum(sum(sides), np.finfo(float).tiny)
    normals = np.cross(u, v)
    twice_area = np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)
    # The centre of the inscribed circle: each corner weighs as much as the side opposite it is long.
    weights = np.stack([sides[2], sides[1], sides[0]], axis=1) / perimeter[:, None]
    centres = np.einsum("fk,fkd->fd", weights, points[faces])
    inscribed = twice_area / perimeter
    directors = carried_directors(mesh, points, angles)

    shown, half = np.arange(len(faces)), 0.92 * inscribed
    if len(faces) > _MOST_LINES:
        apart = np.sqrt(0.35 * twice_area.sum() / _MOST_LINES)
        shown, half = _evenly_spread(centres, apart), np.full(len(faces), 0.45 * apart)
    # Thick enough to be seen in a picture of the whole surface, as far as lines that short can be.
    usual = float(np.median(half[shown]))
    radius = float(np.clip(0.0045 * np.ptp(points, axis=0).max(), 0.1 * usual, 0.17 * usual))
    centres = centres + 1.2 * level * radius * normals / twice_area[:, None]
    half = half[:, None] * directors
    return (centres - half)[shown], (centres + half)[shown], radius


def _evenly_spread(centres: np.ndarray, apart: float) -> np.ndarray:
    """Faces at random, but no two nearer to each other than `apart`."""
    from scipy.spatial import KDTree

    tree = KDTree(centres)
    free = np.ones(len(centres), bool)
    kept = []
    for face in np.random.default_rng(0).permutation(len(centres)):
        if free[face]:
            kept.append(face)
            free[tree.query_ball_point(centres[face], apart)] = False
    return np.array(kept)
