"""Meshes laid out in rows and columns: the rectangle and its kinds of diagonals, the staggered cylinder and torus."""

from typing import Literal

import numpy as np

from .delaunay import delaunay
from .mesh import Mesh
from .sizes import cell_counts, positive


def rectangle(
    length: float,
    width: float,
    cells: tuple[int, int] | None = None,
    target_edge_length: float | None = None,
    diagonals: Literal["right", "alternating", "jittered"] = "right",
    seed: int = 0,
) -> Mesh:
    """A flat sheet over [0, length] x [0, width] at z = 0, with normals along +z.

    Bend it into another shape by moving its vertices: `mesh.with_vertices(...)`. In a mesh of right or alternating
    diagonals the first edge of every face lies along x, so that the director angle 0 is the x axis everywhere.

    **Arguments:**

    - `length`, `width`: along x and y.
    - `cells`: how many cells along x and y, each of two triangles. Vertex `j * (cells[0] + 1) + i` is the corner
        number `i` along x and `j` along y.
    - `target_edge_length`: instead of `cells`, the mean edge length to come near to, with cells nearly square.
    - `diagonals`: `"right"`: all from the lower left to the upper right; `"alternating"`: as the colours of a chess
        board; `"jittered"`: the Delaunay triangulation of grid points moved at random by up to 0.3 of a cell, on the
        boundary along it and at the corners not at all: an irregular mesh, to show what holds on any.
    - `seed`: of the random moves; equal seeds give equal meshes.

    **Returns:** an open `Mesh`.

    **Raises:** `ValueError` for a length that is not positive, unknown `diagonals`, or not exactly one of `cells` and
    `target_edge_length`.
    """
    positive(length=length, width=width)
    if diagonals not in ("right", "alternating", "jittered"):
        raise ValueError(f"diagonals is {diagonals!r}; expected 'right', 'alternating' or 'jittered'.")
    mean = (2 + np.sqrt(2)) / 3  # of the edges of a square cell, of which there are as many along x, y and the diagonal
    nx, ny = cell_counts(cells, target_edge_length, (mean * length, mean * width), least=(1, 1))
    x, y = (grid.ravel().astype(float) for grid in np.meshgrid(np.arange(nx + 1), np.arange(ny + 1)))
    if diagonals == "jittered":
        random = np.random.default_rng(seed)
        x += random.uniform(-0.3, 0.3, x.shape) * ((x > 0) & (x < nx))
        y += random.uniform(-0.3, 0.3, y.shape) * ((y > 0) & (y < ny))
        faces = delaunay(np.stack([x, y], axis=1))
    else:
        faces = _diagonal_faces(nx, ny, diagonals == "alternating")
    points = np.stack([length * (x / nx), width * (y / ny), np.zeros_like(x)], axis=1)
    return Mesh(points, faces)


def cylinder(
    radius: float, length: float, cells: tuple[int, int] | None = None, target_edge_length: float | None = None
) -> Mesh:
    """An open cylinder around the z axis, from z = -length / 2 to length / 2, with outward normals and no seam.

    Every other row of vertices is turned by half a cell, so that the triangles are isosceles and neither sense of twist
    is preferred. The first edge of every face lies along the circumference.

    **Arguments:**

    - `radius`: of the circle on which all vertices lie.
    - `length`: along z.
    - `cells`: how many around (3 or more) and along.
    - `target_edge_length`: instead of `cells`, the edge length to come near to, with triangles nearly equilateral.

    **Returns:** an open `Mesh` with two boundary loops.

    **Raises:** `ValueError` for a length that is not positive, too few cells, or not exactly one of `cells` and
    `target_edge_length`.
    """
    positive(radius=radius, length=length)
    spans = 2 * np.pi * radius, length / (np.sqrt(3) / 2)  # rows of equilateral triangles are that much closer
    around, along = cell_counts(cells, target_edge_length, spans, least=(3, 1))
    angle, row = _staggered_points(around, along + 1)
    z = length * (row / along - 0.5)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    return Mesh(points, _staggered_faces(around, along))


def staggered_torus(major: float, minor: float, cells: tuple[int, int]) -> Mesh:
    """A torus of staggered rows; see `torus`."""
    around, along = cell_counts(cells, None, (0.0, 0.0), least=(3, 4))
    if along % 2:
        raise ValueError(f"cells is {cells}; the second number must be even, since every other row is turned.")
    angle, row = _staggered_points(around, along)
    tube = 2 * np.pi * row / along
    reach = major + minor * np.cos(tube)
    points = np.stack([reach * np.cos(angle), reach * np.sin(angle), minor * np.sin(tube)], axis=1)
    return Mesh(points, _staggered_faces(around, along) % len(points))


def _diagonal_faces(nx, ny, alternating):
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(nx), np.arange(ny)))
    p00 = j * (nx + 1) + i
    p10, p01, p11 = p00 + 1, p00 + nx + 1, p00 + nx + 2
    rising = [[p00, p10, p11], [p11, p01, p00]]
    falling = [[p00, p10, p01], [p11, p01, p10]]
    chosen = np.where(alternating & ((i + j) % 2 == 1), falling, rising)
    return np.moveaxis(chosen, 2, 0).reshape(-1, 3)


def _staggered_points(around, rows):
    row, column = (grid.ravel() for grid in np.mgrid[:rows, :around])
    return 2 * np.pi * (column + 0.5 * (row % 2)) / around, row


def _staggered_faces(around, along):
    row, column = (grid.ravel() for grid in np.mgrid[:along, :around])
    right = (column + 1) % around
    here, above = row * around, (row + 1) * around
    odd = row % 2 == 1
    tip, base = np.where(odd, right, column), np.where(odd, column, right)
    upward = np.stack([here + column, here + right, above + tip], axis=1)
    downward = np.stack([above + right, above + column, here + base], axis=1)
    return np.stack([upward, downward], axis=1).reshape(-1, 3)
