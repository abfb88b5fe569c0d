"""Which vertices are meant: by mask, by index, by edges, or by a predicate on where they lie."""

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Array, Int

from .._mesh.mesh import Mesh
from .._programs.tracing import known


Numbers: TypeAlias = ArrayLike | Sequence
"""An array, or what can be made into one."""

Selection: TypeAlias = ArrayLike | Sequence | Callable
"""A mask of shape (V,), indices of shape (n,), edges as pairs of vertices of shape (m, 2), or a predicate: positions
of shape (V, 3) to such a mask."""


def as_selection(vertices: Selection) -> Array | Callable:
    """What is stored of a selection until the mesh is known."""
    return vertices if callable(vertices) or isinstance(vertices, Tracer) else known(np.asarray(vertices))


def selected(owner: str, vertices: Array | Callable, mesh: Mesh) -> Int[Array, " n"]:
    """The indices of the selected vertices: in the order given, or ascending for a mask, edges or a predicate.

    **Raises:** `ValueError` for a selection that does not fit the mesh, or selects nothing.
    """
    if isinstance(vertices, Tracer):
        return vertices  # spelled out when the problem was built
    chosen: np.ndarray = np.asarray(vertices(mesh.vertices) if callable(vertices) else vertices)
    if chosen.dtype == bool:
        if chosen.shape != (mesh.n_vertices,):
            raise ValueError(
                f"{owner}: the mask of vertices has shape {chosen.shape}; expected one flag a vertex, shape "
                f"({mesh.n_vertices},)."
            )
        chosen = np.flatnonzero(chosen)
    if not np.issubdtype(chosen.dtype, np.integer) or not (
        chosen.ndim == 1 or (chosen.ndim == 2 and chosen.shape[1] == 2)
    ):
        raise ValueError(
            f"{owner}: vertices has shape {chosen.shape} and type {chosen.dtype}; give a mask of shape "
            f"({mesh.n_vertices},), indices of shape (n,), edges of shape (m, 2), or a function of the positions."
        )
    if chosen.size == 0:
        raise ValueError(f"{owner}: no vertex is selected. Look at mesh.vertices, or give the tolerance more room.")
    if chosen.min() < 0 or chosen.max() >= mesh.n_vertices:
        bad = chosen.min() if chosen.min() < 0 else chosen.max()
        raise ValueError(f"{owner}: there is no vertex {bad}; the mesh has the vertices 0 to {mesh.n_vertices - 1}.")
    if chosen.ndim == 2:
        chosen = np.unique(chosen)
    values, counts = np.unique(chosen, return_counts=True)
    if counts.max() > 1:
        raise ValueError(f"{owner}: vertex {values[counts.argmax()]} is selected twice.")
    return known(chosen.astype(np.int32))


def selected_edges(owner: str, vertices: Array | Callable, mesh: Mesh) -> Int[Array, " m"]:
    """The edges of a selection: those listed, or all whose two ends are selected."""
    ends = np.sort(np.asarray(mesh.edges), axis=1)
    if not callable(vertices) and vertices.ndim == 2:
        keys = ends[:, 0].astype(np.int64) * mesh.n_vertices + ends[:, 1]
        listed = np.sort(np.asarray(vertices), axis=1)
        wanted = listed[:, 0].astype(np.int64) * mesh.n_vertices + listed[:, 1]
        missing = np.flatnonzero(~np.isin(wanted, keys))
        if len(missing):
            raise ValueError(f"{owner}: the mesh has no edge between the vertices {listed[missing[0]].tolist()}.")
        chosen = np.isin(keys, wanted)
    else:
        inside = np.zeros(mesh.n_vertices, bool)
        inside[np.asarray(selected(owner, vertices, mesh))] = True
        chosen = inside[ends].all(axis=1)
    return known(np.flatnonzero(chosen).astype(np.int32))
