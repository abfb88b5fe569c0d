"""The three kinds of triangulations on which every statement of convergence is tried, of sheets and of spheres.

R has all diagonals one way, X alternating ones, and J is the Delaunay triangulation of jittered points.
"""

from collections.abc import Callable
from typing import Literal

import numpy as np

import shellkit as sk


Kind = Literal["R", "X", "J"]
KINDS: tuple[Kind, ...] = ("R", "X", "J")
_DIAGONALS = {"R": "right", "X": "alternating", "J": "jittered"}


def sheet(kind: Kind, cells: tuple[int, int], length: float = 1.0, width: float = 1.0, seed: int = 0) -> sk.Mesh:
    """A flat sheet over [0, length] x [0, width]."""
    return sk.meshes.rectangle(length, width, cells=cells, diagonals=_DIAGONALS[kind], seed=seed)


def curved(flat: sk.Mesh, chart: Callable[[np.ndarray], np.ndarray]) -> sk.Mesh:
    """A sheet moved onto a surface by its chart, which takes parameters (n, 2) to points (n, 3)."""
    return flat.with_vertices(chart(np.asarray(flat.vertices)[:, :2]))


def sphere(kind: Kind, cells: int, seed: int = 0) -> sk.Mesh:
    """The unit sphere as a cube, its sides of cells x cells squares, blown up; J is the hull of jittered points."""
    grid = np.arange(cells + 1)
    i, j = (index.ravel() for index in np.meshgrid(grid, grid, indexing="ij"))
    random = np.random.default_rng(seed)
    points, faces = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            a, b = (np.tan(np.pi / 4 * (2 * index / cells - 1)) for index in (i, j))
            side = np.stack([np.full_like(a, sign), a, sign * b], axis=1)
            points.append(np.roll(side, axis, axis=1))
            faces.append(_cells(cells, kind == "X") + len(faces) * len(i))
    points, faces = np.concatenate(points), np.concatenate(faces)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    _, first, number = np.unique(points.round(9), axis=0, return_index=True, return_inverse=True)
    points, faces = points[first], number.reshape(-1)[faces]
    if kind == "J":
        from scipy.spatial import ConvexHull

        points += random.uniform(-0.3, 0.3, points.shape) * np.pi / 2 / cells
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        faces = ConvexHull(points).simplices.astype(int)
    corners = points[faces]
    inward = (corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])).sum(1) < 0
    faces[inward] = faces[inward][:, ::-1]
    return sk.Mesh(points, faces)


def _cells(cells: int, alternating: bool) -> np.ndarray:
    """The triangles of a grid whose vertex (i, j) has the number i * (cells + 1) + j."""
    i, j = (index.ravel() for index in np.mgrid[:cells, :cells])
    low, high = i * (cells + 1) + j, (i + 1) * (cells + 1) + j
    falling = (alternating & ((i + j) % 2 == 1))[:, None, None]
    first = np.array([[low, high, high + 1], [high + 1, low + 1, low]])
    second = np.array([[low, high, low + 1], [high + 1, low + 1, high]])
    return np.where(falling, np.moveaxis(second, 2, 0), np.moveaxis(first, 2, 0)).reshape(-1, 3)
