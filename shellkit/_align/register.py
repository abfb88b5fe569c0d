"""Registration: the rigid motion that lays a surface upon another one that may lie anywhere, without any start."""

import itertools
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from .._geometry.closest import host_closest, search_faces
from .._mesh.mesh import Mesh
from .._programs.tracing import is_traced
from .aligners import Aligner, Motion
from .icp import ICP


_ENOUGH = 1000  # points by which starts are judged
_TRIED = 5  # of the starts, the best ones


def register(mesh: Mesh | ArrayLike | Sequence, target: Mesh | ArrayLike | Sequence, max_steps: int = 50) -> Motion:
    """The rigid motion that lays a surface, or points, upon another one, wherever both lie.

    The principal axes of one are laid upon those of the other in every way that a rotation can, with all signs and,
    as axes of nearly equal moments may be exchanged, in every order; the best of these 24 poses and the given one are
    each improved by [`shellkit.ICP`][], and the best result is taken. Moments are those of the surfaces, not of their
    vertices, so that meshes may be as fine as they like. Both should be of one size and show the whole of one thing: a
    part of it has other moments, and needs [`shellkit.Landmarks`][] as the start of an `ICP`.

    On the host, not differentiable, and not for use under `jax.jit`: as the aligner of a loss take `ICP`.

    **Arguments:**

    - `mesh`: what is to be moved: a [`shellkit.Mesh`][], or points, shape `(n, 3)`.
    - `target`: where it should lie: a mesh, or points, shape `(m, 3)`.
    - `max_steps`: of each `ICP`.

    **Returns:** the [`shellkit.Motion`][]: call it with the mesh, or with any points, to move them. Where several poses
    fit equally well, as for symmetric shapes, it is one of them.

    **Raises:** `ValueError` for points of another shape or fewer than three, and for what is traced.

    ??? example

        ```python
        moved = sk.register(scan, mesh)(scan)
        ```
    """
    if is_traced((mesh, target)):
        raise ValueError("register looks at values, so it cannot be traced: use ICP where a loss needs alignment.")
    points, faces = _taken("mesh", mesh)
    onto, onto_faces = _taken("target", target)
    few = points[:: max(1, len(points) // _ENOUGH)]
    starts = _starts(_moments(points, faces), _moments(onto, onto_faces))
    here, there = jnp.asarray(few), jnp.asarray(onto)

    def misfit(motion: Motion) -> float:
        return _misfit(np.asarray(motion(here)), onto, onto_faces)

    best = sorted(starts, key=misfit)[:_TRIED]
    found = [ICP(onto_faces, start=_Given(start), max_steps=max_steps).motion(here, there) for start in best]
    chosen = min(found, key=misfit)
    if len(few) == len(points):
        return chosen
    return ICP(onto_faces, start=_Given(chosen), max_steps=max_steps).motion(jnp.asarray(points), there)


class _Given(Aligner):
    """A motion that is known."""

    known: Motion

    @property
    def removes_motion(self) -> bool:
        return False

    def motion(self, points: Float[Array, "n 3"], target: Float[Array, "m 3"]) -> Motion:
        return self.known


def _taken(name: str, thing: Mesh | ArrayLike | Sequence) -> tuple[np.ndarray, np.ndarray | None]:
    if isinstance(thing, Mesh):
        return np.asarray(thing.vertices), np.asarray(thing.faces)
    points = np.asarray(thing, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 3:
        raise ValueError(
            f"register: {name} has shape {points.shape}; give a Mesh, or points, shape (n, 3), three or more."
        )
    if not np.isfinite(points).all():
        raise ValueError(f"register: {name} has a point that is not finite, number {_first_bad(points)}.")
    return points, None


def _first_bad(points: np.ndarray) -> int:
    return int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])


def _moments(points: np.ndarray, faces: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """The centre, and the principal axes as columns, right-handed, from the least moment to the largest: of the
    surface if there are faces, else of the points."""
    if faces is None:
        centre = points.mean(axis=0)
        second = (points - centre).T @ (points - centre)
    else:
        corners = points[faces]
        areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        centre = np.average(corners.mean(axis=1), axis=0, weights=areas)
        corners = corners - centre
        # Over a triangle of area A, x xᵀ comes to A / 12 (Σ v vᵀ + s sᵀ) with the corners v and their sum s.
        sums = corners.sum(axis=1)
        second = np.einsum("f,fki,fkj->ij", areas, corners, corners) + np.einsum("f,fi,fj->ij", areas, sums, sums)
    axes = np.linalg.eigh(second)[1]
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return centre, axes


def _starts(moved: tuple[np.ndarray, np.ndarray], onto: tuple[np.ndarray, np.ndarray]) -> list[Motion]:
    """The rotations that lay one set of axes upon the other, and the pose as it is."""
    (centre, axes), (there, onto_axes) = moved, onto
    motions = [Motion(*(jnp.asarray(part) for part in (np.eye(3), centre, centre)))]
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            change = np.eye(3)[list(order)] * np.array(signs)
            if np.linalg.det(change) > 0:
                rotation = axes @ change @ onto_axes.T
                motions.append(Motion(*(jnp.asarray(part) for part in (rotation, centre, there))))
    return motions


def _misfit(points: np.ndarray, target: np.ndarray, faces: np.ndarray | None) -> float:
    """The mean squared distance to the target."""
    if faces is None:
        from scipy.spatial import KDTree

        return float((KDTree(target).query(points)[0] ** 2).mean())
    nearest = search_faces(points, target, faces)
    return float(host_closest(points, target[faces[nearest]])[1].mean())
