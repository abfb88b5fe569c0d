"""Walking on a surface from face to face, straight ahead or along a field of directors. On the host, in plain numbers:
a step is too small a thing for arrays."""

import math
from typing import NamedTuple

import numpy as np

from .._mesh.mesh import Mesh


# Below this the directors around a vertex have no direction in common: a defect, where no line passes.
_ORDERED = 0.15

Vector = tuple[float, float]
Weights = tuple[float, float, float]


class Place(NamedTuple):
    """A point of a surface by its face and the weights of the corners, with a heading in the frame of the face."""

    face: int
    weights: Weights
    heading: Vector


class Walker:
    """A surface to walk on, with directors that turn smoothly over it.

    The angles of the faces are averaged to the vertices as tensors d⊗d, by area, and interpolated from there: a line
    along them has no kinks, and the head of a director cannot be told from its tail.
    """

    def __init__(self, mesh: Mesh, angles: np.ndarray):
        points, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        a, b, c = (points[faces[:, k]] for k in range(3))
        u, v = b - a, c - a
        length = np.linalg.norm(u, axis=1)
        first = u / length[:, None]
        normal = np.cross(u, v)
        twice_area = np.linalg.norm(normal, axis=1)
        normal /= twice_area[:, None]
        second = np.cross(normal, first)
        corner = np.stack([np.sum(v * first, axis=1), twice_area / length], axis=1)

        directors = np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second
        tensors = np.zeros((len(points), 3, 3))
        weighted = twice_area[:, None, None] * directors[:, :, None] * directors[:, None, :]
        total = np.zeros(len(points))
        for k in range(3):
            np.add.at(tensors, faces[:, k], weighted)
            np.add.at(total, faces[:, k], twice_area)
        tensors /= total[:, None, None]
        at_corners = tensors[faces]
        along = lambda x, y: np.einsum("fi,fkij,fj->fk", x, at_corners, y)
        doubled = np.stack([along(first, first) - along(second, second), 2 * along(first, second)], axis=2)

        self.n_faces = len(faces)
        self.normals = [tuple(row) for row in normal.tolist()]
        self._corners = np.stack([a, b, c], axis=1).tolist()
        self._length, self._corner = length.tolist(), [tuple(row) for row in corner.tolist()]
        self._twins = np.asarray(mesh.twins).tolist()
        self._doubled = doubled.tolist()
        self._scale = float(np.sqrt(twice_area.mean()))

    def position(self, place: Place) -> tuple[float, float, float]:
        """Where a place is in space."""
        (a, b, c), (p, q, r) = self._corners[place.face], place.weights
        return (
            p * a[0] + q * b[0] + r * c[0],
            p * a[1] + q * b[1] + r * c[1],
            p * a[2] + q * b[2] + r * c[2],
        )

    def director(self, face: int, weights: Weights, heading: Vector) -> Vector | None:
        """The director there, pointing to the side of the heading; `None` at a defect."""
        x = y = 0.0
        for weight, (p, q) in zip(weights, self._doubled[face], strict=True):
            x, y = x + weight * p, y + weight * q
        if math.hypot(x, y) < _ORDERED:
            return None
        angle = 0.5 * math.atan2(y, x)
        d = math.cos(angle), math.sin(angle)
        return d if d[0] * heading[0] + d[1] * heading[1] >= 0 else (-d[0], -d[1])

    def along_director(self, place: Place, most: float) -> tuple[Place | None, float, bool]:
        """A step along the director by the midpoint rule, no longer than `most` and no further than out of the face.

        Returns the place, how far it is, and whether the way ends there; no place at a defect.
        """
        d = self.director(place.face, place.weights, place.heading)
        if d is None:
            return None, 0.0, True
        reach, _ = self._exit(place, d)
        middle = self._moved(place, d, 0.5 * min(most, reach))
        d = self.director(place.face, middle, d)
        if d is None:
            return None, 0.0, True
        return self._step(place, d, most)

    def straight(self, place: Place, distance: float) -> Place | None:
        """The place at a distance along the geodesic; `None` if it leaves the surface before."""
        for _ in range(100_000):
            there, gone, ended = self._step(place, place.heading, distance)
            distance -= gone
            if ended or there is None:
                return None
            if distance <= 1e-12 * self._scale:
                return there
            place = there
        return None

    def _step(self, place: Place, d: Vector, most: float) -> tuple[Place, float, bool]:
        reach, side = self._exit(place, d)
        if reach >= most:
            return Place(place.face, self._moved(place, d, most), d), most, False
        weights = self._moved(place, d, reach)
        tail, head = weights[(side + 1) % 3], weights[(side + 2) % 3]
        twin = self._twins[place.face][side]
        if twin < 0:
            return Place(place.face, _on_side(side, tail, head), d), reach, True
        face, seen = divmod(twin, 3)
        # The heading keeps its angle to the edge: the two faces are laid flat.
        here = self._edge(place.face, (side + 1) % 3, (side + 2) % 3)
        there = self._edge(face, (seen + 2) % 3, (seen + 1) % 3)
        cos, sin = here[0] * there[0] + here[1] * there[1], here[0] * there[1] - here[1] * there[0]
        heading = cos * d[0] - sin * d[1], sin * d[0] + cos * d[1]
        return Place(face, _on_side(seen, head, tail), heading), reach, False

    def _rates(self, face: int, d: Vector) -> Weights:
        x, y = self._corner[face]
        third = d[1] / y
        second = (d[0] - third * x) / self._length[face]
        return -second - third, second, third

    def _exit(self, place: Place, d: Vector) -> tuple[float, int]:
        reach, side = math.inf, 0
        for k, rate in enumerate(self._rates(place.face, d)):
            # A side that is parallel to the heading is not left through, whatever rounding says.
            if rate < -1e-12 / self._scale:
                to_side = max(place.weights[k], 0.0) / -rate
                if to_side < reach:
                    reach, side = to_side, k
        return reach, side

    def _moved(self, place: Place, d: Vector, distance: float) -> Weights:
        p, q, r = place.weights
        a, b, c = self._rates(place.face, d)
        return p + distance * a, q + distance * b, r + distance * c

    def _edge(self, face: int, tail: int, head: int) -> Vector:
        corners = (0.0, 0.0), (self._length[face], 0.0), self._corner[face]
        x, y = corners[head][0] - corners[tail][0], corners[head][1] - corners[tail][1]
        length = math.hypot(x, y)
        return x / length, y / length


def _on_side(side: int, tail: float, head: float) -> Weights:
    """The weights of a point on a side of a face, from those of the corners that follow on the corner opposite."""
    return ((0.0, tail, head), (head, 0.0, tail), (tail, head, 0.0))[side]
