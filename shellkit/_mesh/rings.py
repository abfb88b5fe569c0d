"""Even, unstructured triangulations of surfaces of revolution: disc, annulus, spherical cap, torus. Vertices start on
rings, are triangulated in a conformal image of the surface in the plane, where Delaunay triangles keep their angles,
and are evened out a few times."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .delaunay import delaunay, in_order
from .grid import staggered_torus
from .mesh import Mesh
from .sizes import one_of, positive
from .smooth import MOVES, ROUNDS, pushed_apart


_GOLDEN = (np.sqrt(5) - 1) / 2


class _Profile(NamedTuple):
    """A surface of revolution about z, and how it is laid conformally into the plane.

    The image of a point at the polar angle φ is the point (log modulus, φ); where the curve begins on the axis, it is
    the point with the polar coordinates (modulus, φ). Faces that are anti-clockwise there have outward normals.
    """

    length: float  # of the generating curve
    curve: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]  # arc length along it -> distance from the axis, z
    onto: Callable[[np.ndarray], np.ndarray]  # points near the surface -> points on it
    modulus: Callable[[np.ndarray], np.ndarray]  # points on the surface -> modulus of their image
    period: float | None = None  # of the log modulus, where the curve is closed


def disc(radius: float, target_edge_length: float) -> Mesh:
    """A flat disc around the origin at z = 0, of nearly equilateral triangles without a preferred direction.

    **Arguments:**

    - `radius`: of the circle on which the boundary's vertices lie, evenly.
    - `target_edge_length`: the mean edge length to come near to.

    **Returns:** an open `Mesh` with normals along +z and a vertex at the origin.

    **Raises:** `ValueError` for a length that is not positive, or edges too long for the shape.
    """
    positive(radius=radius, target_edge_length=target_edge_length)
    return _mesh(_flat(0.0, radius), target_edge_length)


def annulus(inner: float, outer: float, target_edge_length: float, slit: bool = False) -> Mesh:
    """A flat ring around the origin at z = 0, of nearly equilateral triangles.

    **Arguments:**

    - `inner`, `outer`: the radii of its two circles.
    - `target_edge_length`: the mean edge length to come near to.
    - `slit`: cut it open along the positive x axis. The two lips have vertices of their own at the same places; a
        ring's vertices begin at the upper lip, where the polar angle is 0, and end at the lower one.

    **Returns:** an open `Mesh` with normals along +z; slit, it has one boundary loop, otherwise two.

    **Raises:** `ValueError` for a length that is not positive, `inner` not below `outer`, or edges too long for the
    shape.
    """
    positive(inner=inner, outer=outer, target_edge_length=target_edge_length)
    if inner >= outer:
        raise ValueError(f"inner is {inner} and outer is {outer}; expected inner < outer.")
    return _mesh(_flat(inner, outer), target_edge_length, slit)


def spherical_cap(radius: float, angle: float, target_edge_length: float, hole: float = 0.0) -> Mesh:
    """The part of a sphere around the origin that lies within an angle of the z axis: half a sphere for angle = π/2.

    **Arguments:**

    - `radius`: of the sphere, on which every vertex lies.
    - `angle`: between the z axis and the rim, in radians, between 0 and π.
    - `target_edge_length`: the mean edge length to come near to.
    - `hole`: between the z axis and the rim of a hole around the top, in radians; 0 for none.

    **Returns:** an open `Mesh` with outward normals.

    **Raises:** `ValueError` for a length that is not positive, angles out of order, or edges too long for the shape.
    """
    positive(radius=radius, angle=angle, target_edge_length=target_edge_length)
    if not 0 <= hole < angle < np.pi:
        raise ValueError(f"hole is {hole} and angle is {angle}; expected 0 <= hole < angle < pi, in radians.")

    def curve(s):
        return radius * np.sin(hole + s / radius), radius * np.cos(hole + s / radius)

    def onto(points):
        return radius * points / np.linalg.norm(points, axis=1, keepdims=True)

    def modulus(points):  # stereographic projection
        return np.hypot(points[:, 0], points[:, 1]) / (radius + points[:, 2])

    return _mesh(_Profile(radius * (angle - hole), curve, onto, modulus), target_edge_length)


def torus(
    major: float, minor: float, target_edge_length: float | None = None, cells: tuple[int, int] | None = None
) -> Mesh:
    """A torus around the z axis, of nearly equilateral triangles, with outward normals.

    **Arguments:**

    - `major`: from the z axis to the middle of the tube.
    - `minor`: of the tube; less than `major`.
    - `target_edge_length`: the mean edge length to come near to, the same inside and outside.
    - `cells`: instead, how many cells around the axis (3 or more) and around the tube (even, 4 or more), for a regular
        mesh of staggered rows whose triangles are narrower on the inside than on the outside.

    **Returns:** a closed `Mesh` of genus 1.

    **Raises:** `ValueError` for a length that is not positive, `minor` not below `major`, too few cells, or not exactly
    one of `cells` and `target_edge_length`.
    """
    positive(major=major, minor=minor)
    one_of(cells, target_edge_length)
    if minor >= major:
        raise ValueError(f"minor is {minor} and major is {major}; expected minor < major.")
    if cells is not None:
        return staggered_torus(major, minor, cells)
    neck = np.sqrt(major**2 - minor**2)

    def curve(s):
        return major + minor * np.cos(s / minor), -minor * np.sin(s / minor)

    def onto(points):
        axis = np.hypot(points[:, 0], points[:, 1])
        middle = points * [1, 1, 0] * (major / axis)[:, None]
        spoke = points - middle
        return middle + minor * spoke / np.linalg.norm(spoke, axis=1, keepdims=True)

    def modulus(points):
        tube = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]) - major)
        return np.exp(-2 * minor / neck * np.arctan(np.sqrt((major - minor) / (major + minor)) * np.tan(tube / 2)))

    profile = _Profile(2 * np.pi * minor, curve, onto, modulus, 2 * np.pi * minor / neck)
    return _mesh(profile, target_edge_length)


def _flat(inner, outer):
    def modulus(points):
        return np.hypot(points[:, 0], points[:, 1])

    return _Profile(outer - inner, lambda s: (inner + s, 0 * s), lambda points: points, modulus)


def _mesh(profile, target, slit=False):
    points, modulus, angle, free = _rings(profile, target, slit)
    pole = modulus[0] == 0
    # A few edges of the next copy of the plane decide all triangles of this one.
    margin = 0.0 if pole else 6 * target / np.hypot(points[:, 0], points[:, 1]).min()

    def triangulate():
        if pole:
            return delaunay(np.stack([modulus * np.cos(angle), modulus * np.sin(angle)], axis=1))
        return _rolled_up(
            np.stack([np.log(modulus), angle], axis=1), (profile.period, None if slit else 2 * np.pi), margin
        )

    faces = triangulate()
    for _ in range(ROUNDS):
        for _ in range(MOVES):
            points[free] = profile.onto(pushed_apart(points, faces)[free])
        modulus[free] = profile.modulus(points[free])
        angle[free] = np.arctan2(points[free, 1], points[free, 0]) % (2 * np.pi)
        faces = triangulate()
    return Mesh(points, faces)


def _rings(profile, target, slit):
    """Points on rings, the modulus and the angle of their image, and which of them may move."""
    closed = profile.period is not None
    rows = max(3 if closed else 1, round(profile.length / (target * np.sqrt(3) / 2)))
    step = profile.length / rows
    distance, height = profile.curve(step * np.arange(rows if closed else rows + 1))
    # Each vertex of a lattice of equilateral triangles has this area; rows a little off their distance keep it.
    spacing = min(np.clip(target * np.sqrt(3) / 2 / step, 0.8, 1.25) * target, 1.5 * step)
    has_pole = distance[0] <= 1e-12 * profile.length
    circle = min(2 * np.pi * (distance.max() if has_pole else distance.min()), profile.length if closed else np.inf)
    if circle < 5 * target:
        raise ValueError(
            f"target_edge_length is {target}, too large for this shape: its narrowest circle takes five edges or more, "
            f"of a length of at most {circle / 5:.4g}."
        )
    row_modulus = profile.modulus(np.stack([distance, 0 * distance, height], axis=1))
    points, modulus, angles, free = [], [], [], []
    for k, (r, z) in enumerate(zip(distance, height, strict=True)):
        at_pole = k == 0 and has_pole
        n = 1 if at_pole else max(3, round(2 * np.pi * r / spacing))
        if slit:
            angle, lips = np.linspace(0, 2 * np.pi, n + 1), [0, n]
        else:
            # Turned by the golden section from ring to ring, so that no four points lie on a circle by symmetry.
            angle, lips = 2 * np.pi * ((np.arange(n) + k * _GOLDEN) / n % 1), []
        movable = np.full(len(angle), closed or 0 < k < rows)
        movable[lips] = False
        points.append(np.stack([r * np.cos(angle), r * np.sin(angle), np.full(len(angle), z)], axis=1))
        modulus.append(np.full(len(angle), row_modulus[k]))
        angles.append(angle)
        free.append(movable)
    return tuple(np.concatenate(parts) for parts in (points, modulus, angles, free))


def _rolled_up(image, periods, margin):
    """Delaunay triangles of points in a plane that repeats itself with each period."""
    owner, points = np.arange(len(image)), image
    for axis, period in enumerate(periods):
        if period is not None:
            low, high = image[:, axis].min() - margin, image[:, axis].max() + margin
            shifts = period * np.arange(-1, 2)[:, None, None] * np.eye(2)[axis]
            points = (points + shifts).reshape(-1, 2)
            owner = np.tile(owner, 3)
            near = (points[:, axis] >= low) & (points[:, axis] <= high)
            points, owner = points[near], owner[near]
    triangles = delaunay(points)
    # Every triangle is met once in each copy of the plane: keep it where its lowest vertex is the original.
    lowest = np.take_along_axis(triangles, np.argmin(owner[triangles], axis=1)[:, None], axis=1)[:, 0]
    original = (points[lowest] == image[owner[lowest]]).all(1)
    return in_order(owner[triangles[original]])
