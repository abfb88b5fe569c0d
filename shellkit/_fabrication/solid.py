"""A shell as the closed surface of a body of its thickness, for a printer."""

import numpy as np
from jaxtyping import ArrayLike

from .._equilibrium import Equilibrium
from .._mesh.mesh import Mesh
from .._problem.problem import InverseProblem


# Directions in which the normals around a vertex differ by less than this (squared, against the whole) count as flat.
_FLAT = 1e-3


def thicken(thing: Mesh | Equilibrium | InverseProblem, thickness: ArrayLike | None = None) -> Mesh:
    """The closed surface of a body that reaches half the thickness to either side of a shell, with walls along its
    boundaries: to be written as stl, and printed.

    Each vertex is moved so that the faces around it move by half the thickness, as nearly as one vertex allows for all
    of them: corners stay sharp, and the volume is thickness times area, up to the square of the thickness over the
    radius of curvature.

    **Arguments:**

    - `thing`: a mesh, the relaxed shape of an equilibrium, or the surface of a problem at rest.
    - `thickness`: one number, or one per face, in the unit of the mesh; by default that of the equilibrium or problem.

    **Returns:** a closed `Mesh` with outward normals: the upper side first (the vertices of the shell in their order,
    then again for the lower side). A closed shell becomes a body with a cavity, two surfaces.

    **Raises:** `ValueError` without a thickness for a mesh, for one of another shape or not positive, and where the
    shell is curved more sharply than half its thickness, so that the body would cut through itself. Parts that come
    near each other without being neighbours are not looked for.

    ??? example

        ```python
        sk.thicken(problem()).write("shape.stl")
        ```
    """
    if isinstance(thing, Equilibrium):
        mesh, usual = thing.mesh.with_vertices(thing.vertices), thing.rest.thickness
    elif isinstance(thing, InverseProblem):
        mesh, usual = thing.mesh, thing.thickness
    elif isinstance(thing, Mesh):
        mesh, usual = thing, None
    else:
        raise ValueError(f"thicken: a {type(thing).__name__} has no shape; give a Mesh, an Equilibrium or a problem.")
    wanted = usual if thickness is None else thickness
    if wanted is None:
        raise ValueError("thicken: a mesh has no thickness of its own; give thickness=..., in the unit of the mesh.")
    heights = _checked(wanted, mesh)
    points, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    offsets = _offsets(points, faces, heights)
    upper, lower = points + offsets, points - offsets
    for side in (upper, lower):
        _refuse_turned(points, side, faces)
    count = len(points)
    tails, heads = np.asarray(mesh.edges)[np.asarray(mesh.boundary_edges)].T
    walls = np.concatenate(
        [np.stack([heads, tails, tails + count], axis=1), np.stack([heads, tails + count, heads + count], axis=1)]
    )
    return Mesh(np.concatenate([upper, lower]), np.concatenate([faces, faces[:, ::-1] + count, walls]))


def _checked(thickness: ArrayLike, mesh: Mesh) -> np.ndarray:
    heights = np.asarray(thickness, dtype=float)
    if heights.shape not in ((), (mesh.n_faces,)):
        raise ValueError(
            f"thicken: thickness has shape {heights.shape}; give one number or one per face, shape ({mesh.n_faces},)."
        )
    if not (np.isfinite(heights) & (heights > 0)).all():
        raise ValueError("thicken: the thickness must be positive and finite everywhere.")
    return np.broadcast_to(heights, (mesh.n_faces,))


def _normals(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    a, b, c = (points[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    twice_area = np.linalg.norm(normals, axis=1)
    return normals / twice_area[:, None], twice_area


def _offsets(points: np.ndarray, faces: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """For each vertex the shortest m that makes sum A_f (n_f . m - h_f / 2)^2 least, over the faces around it."""
    normals, areas = _normals(points, faces)
    matrix, right = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3))
    for k in range(3):
        np.add.at(matrix, faces[:, k], areas[:, None, None] * normals[:, :, None] * normals[:, None, :])
        np.add.at(right, faces[:, k], (0.5 * areas * heights)[:, None] * normals)
    return np.einsum("vij,vj->vi", np.linalg.pinv(matrix, rcond=_FLAT, hermitian=True), right)


def _refuse_turned(points: np.ndarray, side: np.ndarray, faces: np.ndarray) -> None:
    # A face that is turned inside out through a point keeps its normal, and none of its edges.
    kept = np.sum(_edges(side, faces) * _edges(points, faces), axis=2).min(axis=0) > 0
    a, b, c = (side[faces[:, k]] for k in range(3))
    upright = np.sum(np.cross(b - a, c - a) * _normals(points, faces)[0], axis=1) > 0
    turned = np.flatnonzero(~(kept & upright))
    if len(turned):
        raise ValueError(
            f"thicken: the shell is curved more sharply than half its thickness at face {turned[0]} (and "
            f"{len(turned) - 1} more), so that the body would cut through itself there; make it thinner or smoother."
        )


def _edges(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    return np.stack([points[faces[:, (k + 1) % 3]] - points[faces[:, k]] for k in range(3)])
