"""All fields of a relaxed shape as named arrays, for a file: on vertices and on faces."""

from typing import Any

import numpy as np
from jaxtyping import Array, Float

from .._actuation.director_layers import layer_names
from .._mesh.mesh import Mesh
from .._rest import RestShape
from .carried import carried_directors, edge_vectors
from .stress import density_of, stress_of


Fields = dict[str, np.ndarray]


def vertex_fields(mesh: Mesh, vertices: Float[Array, "V 3"], reactions: Float[Array, "V 3"] | None) -> Fields:
    """The displacement from rest, and the forces of supports where there are any."""
    fields = {"displacement": np.asarray(vertices) - np.asarray(mesh.vertices)}
    return fields if reactions is None else {**fields, "reaction": np.asarray(reactions)}


def face_fields(mesh: Mesh, rest: RestShape, vertices: Float[Array, "V 3"]) -> Fields:
    r"""Thickness at rest, and the elastic strain $\sqrt{B g_r^{-1} B^T} - 1$ with $g = B^T B$: as a tensor in space,
    and its larger and smaller principal value."""
    frames, matrix = _frames(np.asarray(vertices), mesh)
    squared = matrix @ np.linalg.inv(np.asarray(rest.metric)) @ matrix.transpose(0, 2, 1)
    # The root of a symmetric 2 x 2 matrix, by Cayley and Hamilton.
    root = np.sqrt(np.linalg.det(squared))
    trace = np.trace(squared, axis1=1, axis2=2)
    strain = (squared + root[:, None, None] * np.eye(2)) / np.sqrt(trace + 2 * root)[:, None, None] - np.eye(2)
    return {
        "thickness": np.asarray(rest.thickness),
        "strain": _in_space(frames, strain),
        "principal_strains": np.linalg.eigvalsh(strain)[:, ::-1],
    }


def material_fields(
    problem: Any, mesh: Mesh, rest: RestShape, vertices: Float[Array, "V 3"], directors: Float[Array, " E"] | None
) -> Fields:
    """What needs the problem: stress, as a tensor in space and as von Mises' number, the density of the energy, and the
    directors of each layer, carried along."""
    if problem.mesh.n_faces != mesh.n_faces:
        raise ValueError(
            f"Equilibrium.write: the problem has {problem.mesh.n_faces} faces, and the equilibrium {mesh.n_faces}; "
            "give the problem that it is an equilibrium of."
        )
    frames, _ = _frames(np.asarray(vertices), mesh)
    stress = np.asarray(stress_of(problem.energy, mesh, rest, vertices, directors))
    trace = np.trace(stress, axis1=1, axis2=2)
    fields = {
        "stress": _in_space(frames, stress),
        "von_mises": np.sqrt(np.maximum(trace**2 - 3 * np.linalg.det(stress), 0.0)),
        "energy_density": np.asarray(density_of(problem.energy, mesh, rest, vertices, directors)),
    }
    layers = [np.asarray(angles) for angles in problem.actuation.on(mesh).director_fields()]
    for name, angles in zip(layer_names(len(layers)), layers, strict=True):
        name = "director" if len(layers) == 1 else f"{name.replace(' ', '_')}_director"
        fields[name] = carried_directors(mesh, np.asarray(vertices), angles)
    return fields


def _frames(points: np.ndarray, mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """The axes of each face, as columns, the first along its first edge; and B, its edge vectors in them."""
    u, v = edge_vectors(points, mesh)
    length = np.linalg.norm(u, axis=1)
    first = u / length[:, None]
    shift = (first * v).sum(axis=1)
    across = v - shift[:, None] * first
    height = np.linalg.norm(across, axis=1)
    zero = np.zeros_like(length)
    matrix = np.stack([np.stack([length, shift], axis=1), np.stack([zero, height], axis=1)], axis=1)
    return np.stack([first, across / height[:, None]], axis=2), matrix


def _in_space(frames: np.ndarray, tensors: np.ndarray) -> np.ndarray:
    return frames @ tensors @ frames.transpose(0, 2, 1)
