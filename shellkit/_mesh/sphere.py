"""Closed spheres from the icosahedron, by subdivision or at any edge length. Both have a vertex on each pole of the z
axis, outward normals, and the icosahedron's symmetry, so that no direction is preferred."""

import numpy as np

from .delaunay import in_order
from .mesh import Mesh
from .sizes import positive
from .smooth import MOVES, ROUNDS, pushed_apart


def icosphere(subdivisions: int, radius: float = 1.0) -> Mesh:
    """A sphere by repeated subdivision of an icosahedron: each face into four, the new vertices moved onto the sphere.

    From the first subdivision on there is a vertex on each pole of the z axis. Each face begins with its lowest
    corner, so that angle 0 of a director field is a direction that rises.

    **Arguments:**

    - `subdivisions`: how many times, 0 or more; there are `10 * 4**subdivisions + 2` vertices.
    - `radius`: of the sphere, on which every vertex lies.

    **Returns:** a closed `Mesh` around the origin. `sphere` takes any edge length.

    **Raises:** `ValueError` for a radius that is not positive, or `subdivisions` that is no whole number from 0 on.
    """
    positive(radius=radius)
    if int(subdivisions) != subdivisions or subdivisions < 0:
        raise ValueError(f"subdivisions is {subdivisions}; expected a whole number, 0 or more.")
    corners, faces = _icosahedron()
    # An edge of the icosahedron crosses the z axis: its middle is the vertex on the pole from the first subdivision on.
    mesh = Mesh(corners[:, [0, 2, 1]] * [1, 1, -1], faces)
    for _ in range(int(subdivisions)):
        fine = mesh.refine()
        points = np.asarray(fine.vertices)
        mesh = fine.with_vertices(points / np.linalg.norm(points, axis=1, keepdims=True))
    points, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    return Mesh(radius * points, _lowest_corner_first(points, faces))


def sphere(target_edge_length: float, radius: float = 1.0) -> Mesh:
    """A sphere of nearly equal triangles, of any edge length.

    The vertices are those of a geodesic polyhedron: a triangular lattice laid over the faces of the icosahedron, in the
    direction `(b, c)` whose number of vertices, 10 (b² + bc + c²) + 2, comes nearest to the length asked for
    (M. Goldberg, Tohoku Math. J. 43, 1937), evened out on the sphere. Twelve vertices have five neighbours, all others
    six.

    **Arguments:**

    - `target_edge_length`: the mean edge length to come near to.
    - `radius`: of the sphere, on which every vertex lies.

    **Returns:** a closed `Mesh` around the origin.

    **Raises:** `ValueError` for a length that is not positive.
    """
    positive(radius=radius, target_edge_length=target_edge_length)
    points = _geodesic_points(*_lattice(8 * np.pi / np.sqrt(3) * (radius / target_edge_length) ** 2))
    faces = _hull(points)
    for _ in range(ROUNDS * MOVES):
        points = pushed_apart(points, faces)
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    return Mesh(radius * points, faces)


def _lowest_corner_first(points, faces):
    """The faces, each turned so that it begins with the corner of least z; of two such, with that of larger x."""
    x, y, z = points.round(9).T
    rank = np.empty(len(points), int)
    rank[np.lexsort((-y, -x, z))] = np.arange(len(points))
    first = np.argmin(rank[faces], axis=1)
    return faces[np.arange(len(faces))[:, None], (first[:, None] + np.arange(3)) % 3]


def _icosahedron():
    # The lower ring is the upper one turned by half a turn about y, to the last bit.
    angle, height = 2 * np.pi / 5 * np.arange(5), 1 / np.sqrt(5)
    x, y = np.sqrt(0.8) * np.cos(angle), np.sqrt(0.8) * np.sin(angle)
    belt = np.empty((10, 3))
    belt[0::2] = np.stack([x, y, np.full(5, height)], axis=1)
    belt[1::2] = np.stack([-x, y, np.full(5, -height)], axis=1)[[2, 1, 0, 4, 3]]
    vertices = np.vstack([[0, 0, 1], belt, [0, 0, -1]])
    k = np.arange(5)
    up, low, up_next, low_next = 1 + 2 * k, 2 + 2 * k, 1 + (2 * k + 2) % 10, 1 + (2 * k + 3) % 10
    top, bottom = np.zeros(5, int), np.full(5, 11)
    cap = np.stack([top, up, up_next], axis=1)
    belt_faces = np.stack([np.stack([low, up_next, up], axis=1), np.stack([up_next, low, low_next], axis=1)], axis=1)
    base = np.stack([bottom, low_next, low], axis=1)
    return vertices, np.vstack([cap, belt_faces.reshape(-1, 3), base])


def _lattice(n_vertices):
    """The direction (b, c) of the geodesic polyhedron with a number of vertices near the one given."""
    wanted = max((n_vertices - 2) / 10, 1)
    b, c = np.mgrid[1 : int(np.sqrt(wanted)) + 3, 0 : int(np.sqrt(wanted)) + 3]
    b, c = b[c <= b], c[c <= b]
    best = np.argmin(np.abs(np.log((b * b + b * c + c * c) / wanted)))
    return int(b[best]), int(c[best])


def _geodesic_points(b, c):
    from scipy.spatial import KDTree

    corners, faces = _icosahedron()
    # Lattice points (i, j) in the triangle of (0, 0), (b, c) and (b, c) turned by 60 degrees, as barycentric weights.
    size = b * b + b * c + c * c
    i, j = (grid.ravel() for grid in np.mgrid[-c : b + 1, 0 : b + c + 1])
    second, third = i * (b + c) + j * c, j * b - i * c
    weights = np.stack([size - second - third, second, third], axis=1)
    weights = weights[(weights >= 0).all(1)] / size
    # Weights of arcs, not of chords, spread the points more evenly over the sphere.
    arcs = np.sin(weights * np.arccos(1 / np.sqrt(5)))
    points = np.einsum("pk,fkx->fpx", arcs, corners[faces]).reshape(-1, 3)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    pairs = KDTree(points).query_pairs(0.1 / np.sqrt(size), output_type="ndarray")
    points = np.delete(points, pairs.max(axis=1), axis=0)  # on the edges, which two faces share
    return points[np.lexsort((np.arctan2(points[:, 1], points[:, 0]).round(9), -points[:, 2].round(9)))]


def _hull(points):
    """The convex hull of points on a sphere, which is their Delaunay triangulation, with outward normals."""
    from scipy.spatial import ConvexHull

    faces = ConvexHull(points).simplices.astype(int)
    a, b, c = np.moveaxis(points[faces], 1, 0)
    inward = (a * np.cross(b, c)).sum(1) < 0
    faces[inward] = faces[inward][:, ::-1]
    return in_order(faces)
