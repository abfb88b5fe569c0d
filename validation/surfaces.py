"""Smooth surfaces as charts: their forms, and the energy of a mesh on them with the directors alone minimised."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

import shellkit as sk


_STEPS = 20
_SMALL = 1e-12  # radians


def boundary_directors(mesh: sk.Mesh, normals: Float[np.ndarray, "E 3"]) -> Float[np.ndarray, " E"]:
    """Turns of the normals of boundary edges, from that of their face to the given ones; zero inside."""
    points, edges = np.asarray(mesh.vertices), np.asarray(mesh.edges)
    along = points[edges[:, 1]] - points[edges[:, 0]]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    face = np.asarray(sk.face_normals(mesh.vertices, mesh))[np.asarray(mesh.edge_faces)[:, 0]]
    outward = np.cross(along, face)
    turns = np.arctan2((normals * outward).sum(1), (normals * face).sum(1))
    return np.where(np.asarray(mesh.boundary_edges), turns, 0.0)


def minimised(
    problem: sk.InverseProblem, start: Float[np.ndarray, " E"], held: Bool[np.ndarray, " E"]
) -> tuple[float, Float[Array, " E"]]:
    """The least bending energy at a mesh's own vertices, over the directors that are not held; and those directors.

    Found by a method of its own, in numpy: with vertices at rest the energy of a face is quadratic in the three numbers
    that each edge adds to its curvature. The energy returned is the library's at the directors found.
    """
    from scipy.sparse import coo_array, csc_array
    from scipy.sparse.linalg import splu

    mesh, rest = problem.mesh, problem.rest_shape()
    bending = next(term for _, term in problem.energy.weighted_terms() if isinstance(term, sk.Bending))
    points, edges = np.asarray(mesh.vertices), np.asarray(mesh.face_edges)
    ends = points[np.asarray(mesh.edges)]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    heights = 2 * np.asarray(sk.face_areas(mesh.vertices, mesh))[:, None] / lengths[edges]
    stiffness, pull = _face_stiffness(rest, float(bending.alpha), float(bending.beta))
    signs = np.where(np.asarray(mesh.edge_faces)[edges, 0] == np.arange(mesh.n_faces)[:, None], 1.0, -1.0)
    halves = 0.5 * np.asarray(sk.dihedral_angles(mesh.vertices, mesh))
    loose = np.flatnonzero(~held)

    directors = np.array(start, dtype=float)
    for _ in range(_STEPS):
        angles = halves[edges] + signs * directors[edges]
        bend, slope, turn = (2 * heights * f for f in _BEND[bending.form](angles))
        force = np.einsum("fij,fj->fi", stiffness, bend) - pull
        gradient = np.zeros(mesh.n_edges)
        np.add.at(gradient, edges, signs * slope * force)
        blocks = stiffness * (signs * slope)[:, :, None] * (signs * slope)[:, None, :]
        blocks += (turn * force)[:, :, None] * np.eye(3)
        rows, columns = np.broadcast_arrays(edges[:, :, None], edges[:, None, :])
        hessian = coo_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(mesh.n_edges,) * 2).tocsr()
        move = splu(csc_array(hessian[loose][:, loose])).solve(-gradient[loose])
        directors[loose] += move
        if np.abs(move).max() < _SMALL:
            break
    return float(problem.total_energy(mesh.vertices, jnp.asarray(directors))), jnp.asarray(directors)


# How an angle enters the curvature, with its first and second derivatives.
_BEND = {
    "sin": lambda a: (np.sin(a), np.cos(a), -np.sin(a)),
    "tan": lambda a: (np.tan(a), 1 + np.tan(a) ** 2, 2 * np.tan(a) * (1 + np.tan(a) ** 2)),
    "theta": lambda a: (a, np.ones_like(a), np.zeros_like(a)),
}
_BASIS = np.array(
    [[[1, 1], [1, 1]], [[1, 0], [0, 0]], [[0, 0], [0, 1]]], float
)  # what the edges opposite a, b, c add to b


def _face_stiffness(rest: sk.RestShape, alpha: float, beta: float) -> tuple[np.ndarray, np.ndarray]:
    """The energy of a face in what its edges add to the curvature: matrix and linear term, (F, 3, 3) and (F, 3)."""
    metric = np.asarray(rest.metric)
    inverse = np.linalg.inv(metric)
    scale = np.asarray(rest.thickness) ** 3 / 12 * 0.5 * np.sqrt(np.linalg.det(metric))
    parts = np.einsum("fxy,iyz->fixz", inverse, _BASIS)
    wanted = inverse @ np.asarray(rest.curvature)

    def product(a, b):
        traces = np.einsum("fixx->fi", a)[:, :, None] * np.einsum("fjxx->fj", b)[:, None, :]
        return 2 * scale[:, None, None] * (alpha * traces + 2 * beta * np.einsum("fixy,fjyx->fij", a, b))

    return product(parts, parts), product(parts, wanted[:, None])[:, :, 0]


def forms_of(
    chart: Callable[[np.ndarray], np.ndarray], parameters: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 2 2"], Float[np.ndarray, "n 2 2"]]:
    """Unit normals and both fundamental forms of a chart, by central differences; b = dx dn, as in the library."""
    tangents = _tangents(chart, parameters)
    normals = _normals(tangents)
    turns = _tangents(lambda p: _normals(_tangents(chart, p)), parameters)
    curvature = np.einsum("anx,bnx->nab", tangents, turns)
    return normals, np.einsum("anx,bnx->nab", tangents, tangents), 0.5 * (curvature + np.swapaxes(curvature, 1, 2))


def _tangents(function: Callable[[np.ndarray], np.ndarray], parameters: np.ndarray) -> np.ndarray:
    """Both partial derivatives, of fourth order: the error is that of rounding."""
    step = 1e-3
    ahead, behind = (np.stack([function(parameters + sign * step * axis) for axis in np.eye(2)]) for sign in (1, -1))
    further, back = (
        np.stack([function(parameters + 2 * sign * step * axis) for axis in np.eye(2)]) for sign in (1, -1)
    )
    return (8 * (ahead - behind) - (further - back)) / (12 * step)


def _normals(tangents: np.ndarray) -> np.ndarray:
    normals = np.cross(*tangents)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def normals_on_edges(chart: Callable[[np.ndarray], np.ndarray], flat: sk.Mesh) -> Float[np.ndarray, "E 3"]:
    """The normals of the surface at the middle of each edge of a flat sheet, in parameters."""
    middles = np.asarray(flat.vertices)[np.asarray(flat.edges)].mean(1)[:, :2]
    return forms_of(chart, middles)[0]


def curvature_on_faces(chart: Callable[[np.ndarray], np.ndarray], flat: sk.Mesh) -> Float[Array, "F 2 2"]:
    """The second form of the surface at the middle of each face of a flat sheet, in the basis of the face."""
    corners = np.asarray(flat.vertices)[np.asarray(flat.faces)][:, :, :2]
    form = forms_of(chart, corners.mean(1))[2]
    edges = corners[:, 1:] - corners[:, :1]
    return jnp.asarray(np.einsum("fia,fab,fjb->fij", edges, form, edges))
