"""Polygons cut into triangles: of all ways to cut one, without a new vertex, that whose smallest angle is largest."""

import numpy as np
from jaxtyping import Float, Int


_TURNED = -2.0  # the score of a triangle on the wrong side, below that of any that is right: minus a cosine


def split(
    points: Float[np.ndarray, "V 3"], corners: Int[np.ndarray, " n"], sizes: Int[np.ndarray, " P"]
) -> tuple[Int[np.ndarray, "F 3"], Int[np.ndarray, " F"]]:
    """Cuts polygons into triangles, those of one where it stood.

    The best cut is found by dynamic programming over the pieces between two corners (G. T. Klincsek, "Minimal
    triangulations of polygonal domains", Annals of Discrete Mathematics 9 (1980), 121), with the smallest angle in the
    place of the length. Polygons may be bent in and need not be quite flat; triangles stay as they are, and faces of
    fewer corners are left out.

    **Arguments:**

    - `points`: the vertices.
    - `corners`: those of all polygons, one after the other.
    - `sizes`: how many corners each has.

    **Returns:** the triangles, and the polygon that each is a part of.
    """
    starts = np.cumsum(sizes) - sizes
    triangles, owners = [np.zeros((0, 3), int)], [np.zeros(0, int)]
    for size in np.unique(sizes[sizes >= 3]).tolist():
        chosen = np.flatnonzero(sizes == size)
        polygons = corners[starts[chosen][:, None] + np.arange(size)]
        for local, members in _cut(points[polygons]):
            triangles.append(polygons[members][:, local])
            owners.append(chosen[members])
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return np.concatenate(triangles)[order], owner[order]


def _cut(polygons: Float[np.ndarray, "m n 3"]) -> list[tuple[list[int], Int[np.ndarray, " k"]]]:
    """Triangles as three local corners, each with the polygons that have it."""
    count, size, _ = polygons.shape
    if size == 3:
        return [([0, 1, 2], np.arange(count))]
    polygons = polygons - polygons.mean(axis=1, keepdims=True)
    normals = np.cross(polygons, np.roll(polygons, -1, axis=1)).sum(axis=1)
    best = np.full((count, size, size), np.inf)  # the score of the piece from one corner to another
    middle = np.zeros((count, size, size), int)
    for width in range(2, size):
        for i in range(size - width):
            j = i + width
            scores = np.stack(
                [
                    np.minimum(_score(polygons[:, [i, k, j]], normals), np.minimum(best[:, i, k], best[:, k, j]))
                    for k in range(i + 1, j)
                ]
            )
            middle[:, i, j] = i + 1 + scores.argmax(axis=0)
            best[:, i, j] = scores.max(axis=0)
    found, waiting = [], [(0, size - 1, np.arange(count))]
    while waiting:
        i, j, members = waiting.pop()
        for k in range(i + 1, j):
            those = members[middle[members, i, j] == k]
            if len(those):
                found.append(([i, k, j], those))
                waiting += [(i, k, those), (k, j, those)]
    return found


def _score(triangles: Float[np.ndarray, "m 3 3"], normals: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " m"]:
    """Minus the cosine of the smallest angle: it rises with that angle."""
    sides = np.roll(triangles, -2, axis=1) - np.roll(triangles, -1, axis=1)
    squares = (sides**2).sum(axis=2)
    a, b, c = np.sort(squares, axis=1).T
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = (b + c - a) / (2 * np.sqrt(b * c))  # opposite the shortest side
    upright = (np.cross(sides[:, 1], sides[:, 2]) * normals).sum(axis=1) > 0
    return np.where(upright & np.isfinite(cosine), -cosine, _TURNED)
