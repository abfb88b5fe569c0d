"""Evenly spaced streamlines of a director field, after Jobard and Lefer, on flat and on curved surfaces."""

import math
from collections import deque
from collections.abc import Iterator

import numpy as np
from jaxtyping import ArrayLike

from .._actuation.director_layers import director_layers
from .._mesh.mesh import Mesh
from .walker import Place, Walker


Point = tuple[float, float, float]

_STEPS_A_SPACING = 6
_STILL = 30  # steps of no length in a row, as a line turns about a vertex, before it is given up


def streamlines(mesh: Mesh, angles: ArrayLike, spacing: float, closest: float = 0.5) -> list[np.ndarray]:
    """Lines along a director field that lie about as far apart everywhere: the paths of a print head or a laser.

    A line is drawn from a seed both ways, until it comes to the boundary, to a defect, nearer to another line than
    `closest * spacing`, or back to where it began. New seeds lie at the spacing beside lines that are there. Lines
    shorter than the spacing are left out. The angles of the faces are averaged to the vertices and interpolated, which
    rounds off whatever turns within a face or two.

    Distances are measured in space, between points of lines; where the surface folds back on itself within the spacing,
    only points on the same side of it count.

    **Arguments:**

    - `mesh`: the surface at rest, flat or curved.
    - `angles`: of the directors, radians from the first edge of each face, shape `(F,)`.
    - `spacing`: how far apart lines begin, in the unit of the mesh.
    - `closest`: the part of the spacing to which lines may draw near before one ends; 0.5 in the paper. Nearer to 1,
        lines are shorter and more even.

    **Returns:** the lines, each of shape `(n, 3)`, in the order in which they were found. A closed one ends where it
    begins.

    **Raises:** `ValueError` for angles of another shape, a spacing that is not positive, or `closest` outside (0, 1].

    ??? cite "Source"

        B. Jobard and W. Lefer, "Creating evenly-spaced streamlines of arbitrary density", Visualization in Scientific
        Computing '97 (1997), 43.
    """
    (angles,) = director_layers("streamlines", mesh, None, np.asarray(angles, dtype=float))
    if not (math.isfinite(spacing) and spacing > 0):
        raise ValueError(f"streamlines: spacing is {spacing}; give a positive distance in the unit of the mesh.")
    if not 0 < closest <= 1:
        raise ValueError(f"streamlines: closest is {closest}; give a part of the spacing, above 0 and up to 1.")
    return _Placement(Walker(mesh, angles), spacing, closest * spacing).lines()


class _Crowd:
    """Points of lines in cells of a given size, to ask whether one is near."""

    def __init__(self, size: float):
        self._size = size
        self._cells: dict[tuple[int, int, int], list[tuple[Point, Point, float]]] = {}

    def add(self, point: Point, normal: Point, arc: float) -> None:
        """Adds a point, with the normal of its face and how far along its line it lies."""
        self._cells.setdefault(self._cell(point), []).append((point, normal, arc))

    def near(self, point: Point, normal: Point, distance: float) -> Iterator[float]:
        """Where along their lines the points lie that are nearer than a distance, which is at most the size."""
        x, y, z = point
        i, j, k = self._cell(point)
        squared = distance * distance
        for di in (-1, 0, 1):
            for dj in (-1, 0, 1):
                for dk in (-1, 0, 1):
                    for (px, py, pz), n, arc in self._cells.get((i + di, j + dj, k + dk), ()):
                        near = (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2 < squared
                        if near and n[0] * normal[0] + n[1] * normal[1] + n[2] * normal[2] > 0:
                            yield arc

    def _cell(self, point: Point) -> tuple[int, int, int]:
        x, y, z = point
        return math.floor(x / self._size), math.floor(y / self._size), math.floor(z / self._size)


class _Placement:
    """The lines so far, and the way to more."""

    def __init__(self, walker: Walker, spacing: float, closest: float):
        self._walker = walker
        self._spacing = spacing
        self._closest = closest
        self._step = min(spacing / _STEPS_A_SPACING, closest / 2)
        self._others = _Crowd(spacing)

    def lines(self) -> list[np.ndarray]:
        """All lines: beside those that are there while there is room, then wherever there is room left."""
        found: list[np.ndarray] = []
        third = 1 / 3
        centres = (Place(face, (third, third, third), (1.0, 0.0)) for face in range(self._walker.n_faces))
        for seed in centres:
            queue = deque([seed])
            while queue:
                seed = queue.popleft()
                if self._has_room(seed):
                    line, places = self._line(seed)
                    if line is not None:
                        found.append(line)
                    queue.extend(self._seeds_beside(places))
        return found

    def _has_room(self, seed: Place) -> bool:
        # Those beside a line lie at the spacing from it, up to rounding and the curving of the surface.
        point, normal = self._walker.position(seed), self._walker.normals[seed.face]
        return next(self._others.near(point, normal, 0.98 * self._spacing), None) is None

    def _seeds_beside(self, places: list[Place]) -> Iterator[Place]:
        for place in places[:: _STEPS_A_SPACING // 2]:
            x, y = place.heading
            for across in ((-y, x), (y, -x)):
                seed = self._walker.straight(place._replace(heading=across), self._spacing)
                if seed is not None:
                    yield seed

    def _line(self, seed: Place) -> tuple[np.ndarray | None, list[Place]]:
        d = self._walker.director(seed.face, seed.weights, seed.heading)
        if d is None:
            return None, []
        seed = seed._replace(heading=d)
        own = _Crowd(self._spacing)
        start = self._walker.position(seed)
        own.add(start, self._walker.normals[seed.face], 0.0)
        forward, places, closed = self._way(seed, start, own, 1.0)
        backward, more = [], []
        if not closed:
            away = seed._replace(heading=(-d[0], -d[1]))
            backward, more, _ = self._way(away, start, own, -1.0)
        line = [*backward[::-1], start, *forward]
        places = [*more[::-1], seed, *places]
        drawn = np.array(line)
        if np.linalg.norm(np.diff(drawn, axis=0), axis=1).sum() < self._spacing:
            return None, []
        for point, place in zip(line, places, strict=True):
            self._others.add(point, self._walker.normals[place.face], 0.0)
        return drawn, places

    def _way(self, place: Place, start: Point, own: _Crowd, sense: float) -> tuple[list[Point], list[Place], bool]:
        """One way from the seed; the places, and whether it came back to the seed."""
        walker, arc, still = self._walker, 0.0, 0
        points: list[Point] = []
        places: list[Place] = []
        began = place
        while still < _STILL:
            there, gone, ended = walker.along_director(place, self._step)
            if there is None:
                break
            arc += gone
            still = 0 if gone > 1e-9 * self._spacing else still + 1
            point, normal = walker.position(there), walker.normals[there.face]
            if next(self._others.near(point, normal, self._closest), None) is not None:
                break
            if sense > 0 and arc > 2 * self._spacing and math.dist(point, start) < self._step:
                return [*points, start], [*places, began], True
            if self._meets_itself(own, point, normal, sense * arc):
                break
            if gone > 1e-9 * self._spacing:
                points.append(point)
                places.append(there)
                own.add(point, normal, sense * arc)
            place = there
            if ended:
                break
        return points, places, False

    def _meets_itself(self, own: _Crowd, point: Point, normal: Point, arc: float) -> bool:
        # What is near along the line does not count, nor does its beginning, where it may close.
        for other in own.near(point, normal, self._closest):
            if abs(arc - other) > 2 * self._spacing and not (arc > 0 and 0 <= other < self._closest):
                return True
        return False
