"""Closest points: which triangle or point of a surface lies nearest, searched exactly on the host, and where on it, in
JAX. The search has no derivative and needs none: the closest point is computed again from what was found, so that all
its derivatives are exact wherever the nearest corner, edge or inside of a triangle stays the same under small moves."""

import atexit
import functools
import importlib.util
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from .rowwise import dot, over, unit


_Nearest: TypeAlias = tuple[np.ndarray, np.ndarray]  # squared distances, shape (n,), and the numbers of the faces
_FIRST = 8  # neighbours asked for at first; then four times as many for those that are not settled
_ON_SIDE = 1e-12  # a barycentric weight that is as good as zero
_PAIRS = 400_000  # pairs of a point and a triangle measured at once


class ClosestPoints(NamedTuple):
    """The nearest point of a surface for each of n points: where it is, its triangle, its barycentric weights there."""

    points: Float[Array, "n 3"]
    faces: Int[Array, " n"]
    weights: Float[Array, "n 3"]


def closest_points(
    points: Float[Array, "n 3"], vertices: Float[Array, "V 3"], faces: Int[Array, "F 3"]
) -> ClosestPoints:
    """The nearest point of a triangulated surface for each of some points.

    Differentiable in the points and in the vertices, to any order, forwards and backwards. The derivatives jump where
    the nearest point passes over an edge or a corner; where two parts of the surface are equally near, the nearest
    point itself jumps, but not the distance.

    **Arguments:**

    - `points`: shape `(n, 3)`.
    - `vertices`, `faces`: the surface.

    **Returns:**

    The [`ClosestPoints`][]. Points that are not finite are answered by face 0.
    """
    found = nearest_faces(points, vertices, faces)
    weights = _weights_of_closest(points, *(vertices[faces[found, corner]] for corner in range(3)))
    return ClosestPoints(interpolate(vertices, faces, found, weights), found, weights)


def nearest_faces(
    points: Float[Array, "n 3"], vertices: Float[Array, "V 3"], faces: Int[Array, "F 3"]
) -> Int[Array, " n"]:
    """The number of the face that is nearest to each point. No derivative."""
    return jax.pure_callback(
        _search_faces,
        jax.ShapeDtypeStruct(points.shape[:1], jnp.int32),
        jax.lax.stop_gradient(points),
        jax.lax.stop_gradient(vertices),
        faces,
        vmap_method="sequential",
    )


def nearest_points(points: Float[Array, "n 3"], target: Float[Array, "m 3"]) -> Int[Array, " n"]:
    """The number of the point of another set that is nearest to each point. No derivative."""
    return jax.pure_callback(
        _search_points,
        jax.ShapeDtypeStruct(points.shape[:1], jnp.int32),
        jax.lax.stop_gradient(points),
        jax.lax.stop_gradient(target),
        vmap_method="sequential",
    )


def interpolate(
    values: Float[Array, "V *k"], faces: Int[Array, "F 3"], found: Int[Array, " n"], weights: Float[Array, "n 3"]
) -> Float[Array, "n *k"]:
    """A field on the vertices of a surface at points given by their face and their barycentric weights there."""
    return sum(weights[:, corner, None] * values[faces[found, corner]] for corner in range(3))  # pyright: ignore


def normal_projections(
    closest: ClosestPoints, vertices: Float[Array, "V 3"], faces: Int[Array, "F 3"]
) -> Float[Array, "n 3 3"]:
    """The derivative of points less their nearest points, in the points: a projection on the normal inside a face, on
    the plane across an edge, and on all of space at a corner."""
    corners = vertices[faces[closest.faces]]
    normals = unit(jnp.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    absent = closest.weights < _ON_SIDE
    sides = jnp.roll(corners, 1, axis=1) - jnp.roll(corners, -1, axis=1)
    along = unit(jnp.sum(jnp.where(absent[:, :, None], sides, 0), axis=1))
    eye = jnp.eye(3, dtype=vertices.dtype)
    inside = normals[:, :, None] * normals[:, None, :]
    across = eye - along[:, :, None] * along[:, None, :]
    count = jnp.sum(absent, axis=1)[:, None, None]
    return jnp.where(count == 0, inside, jnp.where(count == 1, across, eye))


def _weights_of_closest(
    p: Float[Array, "n 3"], a: Float[Array, "n 3"], b: Float[Array, "n 3"], c: Float[Array, "n 3"]
) -> Float[Array, "n 3"]:
    """Barycentric weights of the point of triangle (a, b, c) nearest to p: that of its plane, if inside, or the nearest
    of its three sides."""
    u, v, d = b - a, c - a, p - a
    uu, uv, vv, ud, vd = dot(u, u), dot(u, v), dot(v, v), dot(u, d), dot(v, d)
    determinant = uu * vv - uv * uv
    s, t = over(vv * ud - uv * vd, determinant), over(uu * vd - uv * ud, determinant)
    inside = (s >= 0) & (t >= 0) & (s + t <= 1) & (determinant > 0)
    along_u, along_v = jnp.clip(over(ud, uu), 0, 1), jnp.clip(over(vd, vv), 0, 1)
    w = v - u
    along_w = jnp.clip(over(dot(w, d - u), dot(w, w)), 0, 1)
    zero = jnp.zeros_like(s)
    sides = [(along_u, zero), (zero, along_v), (1 - along_w, along_w)]
    squared = jnp.stack([_squared(d - s[:, None] * u - t[:, None] * v) for s, t in sides])
    side = jnp.argmin(squared, axis=0)
    for number, (s_side, t_side) in enumerate(sides):
        here = ~inside & (side == number)
        s, t = jnp.where(here, s_side, s), jnp.where(here, t_side, t)
    return jnp.stack([1 - s - t, s, t], axis=1)


def _squared(d: Float[Array, "n 3"]) -> Float[Array, " n"]:
    return jax.lax.stop_gradient(dot(d, d))


def host_closest(points: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each row the nearest point of its own triangle, and its squared distance; numpy, for searches.

    **Arguments:**

    - `points`: shape `(n, 3)`.
    - `corners`: shape `(n, 3, 3)`, the corners of one triangle a row.
    """
    # Components first: numpy is quickest along long contiguous axes.
    p = np.ascontiguousarray(points.T)
    a, b, c = (np.ascontiguousarray(corners[:, corner].T) for corner in range(3))
    u, v, d = b - a, c - a, p - a
    uu, uv, vv, ud, vd = _dot(u, u), _dot(u, v), _dot(v, v), _dot(u, d), _dot(v, d)
    determinant = uu * vv - uv * uv
    with np.errstate(divide="ignore", invalid="ignore"):
        s, t = (vv * ud - uv * vd) / determinant, (uu * vd - uv * ud) / determinant
        inside = (s >= 0) & (t >= 0) & (s + t <= 1) & (determinant > 0)
        along_u, along_v = (np.clip(np.nan_to_num(x), 0, 1) for x in (ud / uu, vd / vv))
        ww, wd = uu - 2 * uv + vv, vd - ud - uv + uu
        along_w = np.clip(np.nan_to_num(wd / ww), 0, 1)
    s, t = np.where(inside, s, 0), np.where(inside, t, 0)
    closest = a + s * u + t * v
    best = np.where(inside, _dot(p - closest, p - closest), np.inf)
    for s, t in ((along_u, 0), (0, along_v), (1 - along_w, along_w)):
        on_side = a + s * u + t * v
        squared = _dot(p - on_side, p - on_side)
        nearer = squared < best
        best, closest = np.where(nearer, squared, best), np.where(nearer, on_side, closest)
    return closest.T, best


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def search_faces(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The number of the nearest face of each point, exactly: by libigl where it is installed, else by SciPy."""
    found = np.zeros(len(points), np.int32)
    known = np.isfinite(points).all(axis=1)
    if np.isfinite(vertices).all() and known.any():
        search = _search_by_scipy if _igl() is None else _search_by_tree
        found[known] = search(points[known], vertices, faces.astype(np.int64))[1]
    return found


@functools.cache
def _igl() -> Any:
    return importlib.import_module("igl") if importlib.util.find_spec("igl") else None


def _search_by_tree(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> _Nearest:
    """Squared distances and numbers of the nearest faces, by a tree of boxes that is kept for the next search: an
    alignment asks for the same surface dozens of times."""
    vertices, faces = np.ascontiguousarray(vertices, float), np.ascontiguousarray(faces)
    tree = _tree(vertices.tobytes(), faces.tobytes())
    squared, found, _ = tree.squared_distance(vertices, faces, np.ascontiguousarray(points, float))
    return squared, found


@functools.lru_cache(maxsize=4)
def _tree(vertices: bytes, faces: bytes) -> Any:
    tree = _igl().AABB()
    tree.init(np.frombuffer(vertices).reshape(-1, 3), np.frombuffer(faces, np.int64).reshape(-1, 3))
    return tree


# Trees that outlive the interpreter are reported as leaks by the library.
atexit.register(_tree.cache_clear)


def _search_by_scipy(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> _Nearest:
    """Squared distances and numbers of the nearest faces.

    A triangle lies within a ball about its centroid, so that none beyond a certain distance of centroids can be
    nearer than the best found. Triangles are sorted by the size of their balls, since the largest decides how far to
    look.
    """
    from scipy.spatial import KDTree

    corners = vertices[faces]
    centroids = corners.mean(axis=1)
    radii = np.sqrt(((corners - centroids[:, None]) ** 2).sum(axis=2).max(axis=1))
    size = np.floor(np.log2(np.maximum(radii, radii.max() * 2.0**-20)))
    best = np.full(len(points), np.inf)
    nearest = np.zeros(len(points), np.int32)
    for octave in np.unique(size):
        members = np.flatnonzero(size == octave)
        tree, reach = KDTree(centroids[members]), radii[members].max()
        open_, asked, tested = np.arange(len(points)), min(_FIRST, len(members)), 0
        while len(open_):
            answers = (np.reshape(part, (len(open_), asked)) for part in tree.query(points[open_], k=asked))
            distance, index = (part[:, tested:] for part in answers)
            for row in range(0, len(open_), max(1, _PAIRS // (asked - tested))):
                rows = slice(row, row + max(1, _PAIRS // (asked - tested)))
                _take_nearer(points, open_[rows], members[index[rows]], distance[rows], radii, corners, best, nearest)
            if asked == len(members):
                break
            open_ = open_[distance[:, -1] - reach < np.sqrt(best[open_])]
            tested, asked = asked, min(4 * asked, len(members))
    return best, nearest


def _take_nearer(
    points: np.ndarray,
    rows: np.ndarray,
    candidates: np.ndarray,
    distance: np.ndarray,
    radii: np.ndarray,
    corners: np.ndarray,
    best: np.ndarray,
    nearest: np.ndarray,
) -> None:
    """Measures those candidates that may be nearer than the best, and writes the nearest of them into `best` and
    `nearest`.

    **Arguments:**

    - `points`: all of them, shape `(n, 3)`.
    - `rows`: which points are asked about, shape `(k,)`.
    - `candidates`, `distance`: for each of those the numbers of some faces, and how far their centroids are, shape
        `(k, m)`.
    - `radii`, `corners`: of all faces, shapes `(F,)` and `(F, 3, 3)`.
    - `best`, `nearest`: squared distances and faces found so far for all points, shape `(n,)`; changed in place.
    """
    which, column = np.nonzero(distance - radii[candidates] < np.sqrt(best[rows])[:, None])
    if not len(which):
        return
    face = candidates[which, column]
    _, squared = host_closest(points[rows[which]], corners[face])
    order = np.lexsort((squared, which))
    first = order[np.flatnonzero(np.diff(which[order], prepend=-1))]
    won = first[squared[first] < best[rows[which[first]]]]
    best[rows[which[won]]] = squared[won]
    nearest[rows[which[won]]] = face[won]


def _search_faces(points: ArrayLike, vertices: ArrayLike, faces: ArrayLike) -> np.ndarray:
    return search_faces(np.asarray(points), np.asarray(vertices), np.asarray(faces))


def _search_points(points: ArrayLike, target: ArrayLike) -> np.ndarray:
    from scipy.spatial import KDTree

    points, target = np.asarray(points), np.asarray(target)
    found = np.zeros(len(points), np.int32)
    known = np.isfinite(points).all(axis=1)
    if np.isfinite(target).all() and known.any():
        found[known] = KDTree(target).query(points[known])[1]
    return found
