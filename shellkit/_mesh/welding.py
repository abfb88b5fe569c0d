"""Vertices joined where they coincide, or nearly so: for files that hold each triangle by itself, or tear a surface
along seams."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .connectivity import components


# What counts as one place where no tolerance is given: this part of the diagonal of the box around the surface, but no
# more than this part of the shortest edge at a vertex. Of the vertices that no face joins yet, two so near are one.
_PART_OF_DIAGONAL = 1e-4
_PART_OF_EDGE = 0.1
_MOST_VANISHING = 0.1  # of the faces, by joining their own corners


class Welded(NamedTuple):
    """A surface with fewer vertices: which of the old vertices and faces are left, and the faces in new numbers."""

    points: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]
    kept_vertices: Int[np.ndarray, " V"]
    kept_faces: Int[np.ndarray, " F"]


def weld(points: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"], tolerance: float | None) -> Welded:
    """Joins vertices, numbers them as they are met, and leaves out faces without three different corners, and all but
    the first of those with equal ones.

    **Arguments:**

    - `points`, `faces`: the surface.
    - `tolerance`: vertices up to so far apart become one, in their mean, and so do chains of them. With `None` equal
        ones do, and those at open edges that are far nearer to each other than to any other vertex.

    **Raises:** `ValueError` where a tenth of the faces or more would vanish.
    """
    equal = _equal(points)
    joined = _joined(points, faces, equal)
    if tolerance == 0:
        return joined
    near = _near(joined, tolerance)
    both = _joined(points, faces, near[equal])
    lost = len(joined.faces) - len(both.faces)
    if lost > _MOST_VANISHING * len(joined.faces):
        corners = joined.points[joined.faces]
        shortest = np.linalg.norm(np.roll(corners, 1, axis=1) - corners, axis=2).min()
        raise ValueError(
            f"weld={tolerance:g} joins corners of the same face: {lost} of {len(joined.faces)} faces would vanish. The "
            f"shortest edge is {shortest:.3g}; give a tolerance far below that, or weld=True."
        )
    return both


def coincident(points: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> int:
    """How many vertices would go if those that coincide were joined, without a tolerance."""
    return len(points) - len(np.unique(_near(_joined(points, faces, _equal(points)), None)))


def open_vertices(faces: Int[np.ndarray, "F 3"], n_vertices: int) -> Int[np.ndarray, " k"]:
    """The vertices at edges of one face."""
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1).astype(np.int64)
    keys, counts = np.unique(ends[:, 0] * n_vertices + ends[:, 1], return_counts=True)
    alone = keys[counts == 1]
    return np.unique(np.concatenate([alone // n_vertices, alone % n_vertices]))


def _equal(points):
    """A number for each place, in the order in which places are met."""
    _, first, inverse = np.unique(points + 0.0, axis=0, return_index=True, return_inverse=True)  # no -0.0
    return _as_met(first, inverse.reshape(-1))


def _as_met(first, inverse):
    number = np.empty_like(first)
    number[np.argsort(first)] = np.arange(len(first))
    return number[inverse]


def _near(surface, tolerance):
    """A number for each vertex, the same for those that lie near each other."""
    from scipy.spatial import KDTree

    points, faces = surface.points, surface.faces
    if tolerance is None:
        chosen = open_vertices(faces, len(points))
        diagonal = np.linalg.norm(np.ptp(points, axis=0))
        limits = np.minimum(_PART_OF_DIAGONAL * diagonal, _PART_OF_EDGE * _shortest_edges(points, faces))[chosen]
    else:
        chosen, limits = np.arange(len(points)), np.full(len(points), float(tolerance))
    if not len(chosen) or not np.isfinite(points).all():
        return np.arange(len(points))
    a, b = KDTree(points[chosen]).query_pairs(limits.max(), output_type="ndarray").T
    near = np.linalg.norm(points[chosen[a]] - points[chosen[b]], axis=1) <= np.minimum(limits[a], limits[b])
    _, label = components(len(points), chosen[a[near]], chosen[b[near]])
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    return _as_met(first, inverse.reshape(-1))


def _shortest_edges(points, faces):
    """The length of the shortest edge at each vertex; infinite where there is none."""
    shortest = np.full(len(points), np.inf)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        lengths = np.linalg.norm(points[faces[:, i]] - points[faces[:, j]], axis=1)
        np.minimum.at(shortest, faces[:, i], lengths)
        np.minimum.at(shortest, faces[:, j], lengths)
    return shortest


def _joined(points, faces, number):
    count = int(number.max()) + 1 if len(number) else 0
    kept = np.full(count, len(points))
    np.minimum.at(kept, number, np.arange(len(points)))
    # The mean as a shift from the first, so that equal ones stay where they are to the last digit.
    shift, sizes = np.zeros((count, 3)), np.bincount(number, minlength=count)
    np.add.at(shift, number, points - points[kept[number]])
    faces = number[faces]
    whole = np.flatnonzero((faces != np.roll(faces, 1, axis=1)).all(axis=1))
    _, first = np.unique(np.sort(faces[whole], axis=1), axis=0, return_index=True)
    rows = whole[np.sort(first)]
    return Welded(points[kept] + shift / sizes[:, None], faces[rows], kept, rows)
