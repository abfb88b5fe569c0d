"""Delaunay triangulations, ordered so that equal points give equal faces."""

import numpy as np
from jaxtyping import Float, Int


def delaunay(points: Float[np.ndarray, "V 2"]) -> Int[np.ndarray, "F 3"]:
    """The Delaunay triangles of points in the plane, anti-clockwise.

    Those without area, which three points on a straight side of the hull can make, are left out.
    """
    from scipy.spatial import Delaunay

    faces = Delaunay(points).simplices.astype(int)
    u, v = points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    faces[area < 0] = faces[area < 0][:, ::-1]
    return in_order(faces[np.abs(area) > 1e-10 * np.abs(area).max()])


def in_order(faces: Int[np.ndarray, "F 3"]) -> Int[np.ndarray, "F 3"]:
    """Each face from its lowest vertex on, and the faces by their vertices."""
    faces = np.take_along_axis(faces, (np.argmin(faces, axis=1)[:, None] + np.arange(3)) % 3, axis=1)
    return faces[np.lexsort(faces.T[::-1])]
