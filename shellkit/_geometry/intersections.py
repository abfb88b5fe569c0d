"""Where a surface runs through itself: pairs of faces found by a tree of their centres, then told apart by separating
axes. Nothing else in the library looks, so an impossible design would be printed unawares."""

import numpy as np
from jaxtyping import Array, Float, Int

from .._mesh.mesh import Mesh


_TOLERANCE = 1e-12  # of the size of the surface: what is less deep is a touch
_BLOCK = 100_000  # pairs tested at once


def self_intersections(vertices: Float[Array | np.ndarray, "V 3"], mesh: Mesh) -> Int[np.ndarray, "n 2"]:
    """The pairs of faces that run through each other.

    Faces that only touch do not count: neighbours share an edge or a corner, and two faces may rest on each other. So
    sheets that cross exactly along edges of both are passed over; a neighbour that is folded back flat onto its
    neighbour is not. The thickness of the shell is not looked at. On the host; not for use under `jax.jit`.

    **Arguments:**

    - `vertices`: positions, shape `(V, 3)`, such as those of an equilibrium.
    - `mesh`: the connectivity.

    **Returns:**

    Indices of faces, shape `(n, 2)`, the smaller first, in ascending order; `(0, 2)` for a surface that has none.

    **Raises:**

    `ValueError` if a position is not finite.

    ??? cite "Source"

        Separating axes of two triangles: C. Ericson, "Real-time collision detection" (2005), section 5.2.
    """
    x = np.asarray(vertices, dtype=float)
    bad = np.flatnonzero(~np.isfinite(x).all(axis=1))
    if len(bad):
        raise ValueError(f"self_intersections: the position of vertex {bad[0]} is not finite.")
    x = x - x.mean(axis=0)
    tolerance = _TOLERANCE * np.abs(x).max(initial=0.0)
    triangles = x[np.asarray(mesh.faces)]
    pairs = _candidates(triangles)
    found = [
        block[_cross(triangles[block[:, 0]], triangles[block[:, 1]], tolerance)]
        for block in np.array_split(pairs, max(1, -(-len(pairs) // _BLOCK)))
    ]
    pairs = np.concatenate(found)
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


def _candidates(triangles: Float[np.ndarray, "F 3 3"]) -> Int[np.ndarray, "n 2"]:
    """Pairs of triangles of which the boxes overlap."""
    from scipy.spatial import KDTree

    low, high = triangles.min(axis=1), triangles.max(axis=1)
    centres = 0.5 * (low + high)
    radii = 0.5 * np.linalg.norm(high - low, axis=1)
    tree = KDTree(centres)
    # Each pair is found from its larger face, from which the centre of the smaller is at most two radii away.
    near = tree.query_ball_point(centres, 2 * radii * (1 + 1e-12))
    first = np.repeat(np.arange(len(triangles)), [len(n) for n in near])
    pairs = np.column_stack([first, np.concatenate([np.asarray(n, dtype=int) for n in near])])
    pairs = np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)
    first, second = pairs.T
    overlap = ((low[first] <= high[second]) & (low[second] <= high[first])).all(axis=1)
    return pairs[overlap]


def _cross(first: Float[np.ndarray, "n 3 3"], second: Float[np.ndarray, "n 3 3"], tolerance: float) -> np.ndarray:
    """Whether the insides of two triangles meet: no axis has them on two sides of a plane.

    Along the axes that can separate two flat triangles: both normals, the products of their edges, and in each plane
    the normals of the edges. An axis along which both have no width says nothing.
    """
    edges = [np.roll(t, -1, axis=1) - t for t in (first, second)]
    normals = [np.cross(e[:, 0], e[:, 1]) for e in edges]
    axes = [normals[0], normals[1]]
    axes += [np.cross(edges[0][:, i], edges[1][:, j]) for i in range(3) for j in range(3)]
    axes += [np.cross(normals[k], edges[k][:, i]) for k in range(2) for i in range(3)]
    sizes = [np.linalg.norm(e, axis=2).max(axis=1) for e in edges]
    scales = [sizes[0] ** 2, sizes[1] ** 2] + [sizes[0] * sizes[1]] * 9 + [sizes[0] ** 3] * 3 + [sizes[1] ** 3] * 3
    apart = np.zeros(len(first), bool)
    for axis, scale in zip(axes, scales, strict=True):
        length = np.linalg.norm(axis, axis=1)
        # Nearly parallel edges give no direction: what is left of them is rounding.
        known = length > 1e-9 * scale
        axis = axis / np.where(known, length, 1.0)[:, None]
        heights = [np.einsum("nij,nj->ni", t, axis) for t in (first, second)]
        (low, high), (low_2, high_2) = ((h.min(axis=1), h.max(axis=1)) for h in heights)
        depth = np.minimum(high - low_2, high_2 - low)
        width = np.maximum(high - low, high_2 - low_2)
        apart |= known & (depth <= tolerance) & (width > tolerance)
    return ~apart
