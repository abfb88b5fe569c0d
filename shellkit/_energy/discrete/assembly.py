"""From elements to vectors and matrices: the sparsity of a scene's Hessian, and where each element adds.

All of it depends on connectivity, terms and supports alone, and is found once, in numpy, when a problem is built.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..._geometry.patches import CORNER_PAIRS
from ..._mesh.mesh import Mesh
from ..._programs.tracing import known
from ..._solve.matrices.operator import SparseSymmetric
from ..._solve.matrices.pattern import SymmetricPattern
from ..._supports.base import Supports
from ..base import AbstractEnergy
from ..terms import Terms
from .convexity import Blocks, FaceHessians, negative_part
from .dofs import DofMap
from .frames import Frames


class Assembly(eqx.Module):
    """Where the derivatives of each element add, in the gradient and in the sparse Hessian of one scene.

    Entries of the index arrays beyond the last row or non-zero are dropped when they are added.
    """

    dofs: DofMap
    pattern: SymmetricPattern
    stencils: tuple[Int[Array, "_ _"], ...]
    face_unknowns: Int[Array, "m F"] | None
    face_numbers: Int[Array, " t"] | None  # which of the numbers in the blocks of faces, one after the other, are added
    face_entries: Int[Array, " t"] | None  # and to which non-zero
    element_entries: tuple[Int[Array, "_ _ 3 _ 3"] | None, ...]  # None for a term that is linear
    n_constraints: int = eqx.field(static=True)

    @classmethod
    def of(cls, energy: AbstractEnergy, mesh: Mesh, supports: Supports | None = None) -> "Assembly":
        """Number the unknowns of an energy on a mesh.

        **Arguments:**

        - `energy`: the sum of terms.
        - `mesh`: the surface.
        - `supports`: what is held, spelled out for the mesh; `None` for nothing.
        """
        terms = Terms.of(energy)
        directors = mesh.n_edges if terms.has_free_directors else 0
        size = 3 * mesh.n_vertices + directors

        # Nodes are vertices (three unknowns) and, behind them, edges with a director (one).
        face_nodes = None
        if terms.faces:
            parts = [np.asarray(mesh.faces)]
            if terms.bends:
                parts.append(np.asarray(mesh.face_opposite))
            if directors:
                parts.append(mesh.n_vertices + np.asarray(mesh.face_edges))
            face_nodes = np.hstack(parts)
        measured = terms.measured
        stencils = [np.asarray(term.stencil(mesh)) for term in measured]
        for term, stencil in zip(measured, stencils, strict=True):
            _check_stencil(type(term).__name__, stencil, mesh)

        curved = [stencil for term, stencil in zip(measured, stencils, strict=True) if not term.linear]
        groups = ([] if face_nodes is None else [face_nodes]) + curved
        held = np.zeros(size, bool) if supports is None else supports.held(mesh, directors)
        turned = None if supports is None else supports.frames(mesh)
        listed = held.copy()
        if turned is not None:
            # A Hessian is turned into the frames with all coordinates of their vertices.
            listed[(3 * turned[0][:, None] + np.arange(3)).reshape(-1)] = False
        pattern, entries = _entries(groups, listed, mesh.n_vertices)
        frames = None
        face_numbers = face_entries = None
        if face_nodes is not None:
            blocks = _face_entries(entries.pop(0), pattern.nnz)
            targets = np.concatenate([block.reshape(-1) for block in blocks])
            face_numbers = np.flatnonzero(targets < pattern.nnz).astype(np.int32)
            face_numbers, face_entries = known(face_numbers), known(targets[face_numbers])
        by_term = iter(entries)
        element_entries = tuple(
            None if term.linear else known(next(by_term).reshape(len(s), s.shape[1], 3, s.shape[1], 3))
            for term, s in zip(measured, stencils, strict=True)
        )
        if turned is not None:
            frames, pattern = Frames.of(*turned, pattern, np.flatnonzero(~listed), held, mesh.n_vertices)
        return cls(
            dofs=DofMap.of(mesh, directors, held, frames),
            pattern=pattern,
            stencils=tuple(known(stencil.astype(np.int32)) for stencil in stencils),
            face_unknowns=None if face_nodes is None else known(_unknowns(face_nodes, mesh.n_vertices)),
            face_numbers=face_numbers,
            face_entries=face_entries,
            element_entries=element_entries,
            n_constraints=len(terms.constraints),
        )

    def on_faces(self, step: Float[Array, " n"]) -> Float[Array, "m F"]:
        """What a step of the free unknowns is in the unknowns of each face; zero for those that a face lacks."""
        dofs, coordinates = self.dofs, slice(0, 3 * self.dofs.n_vertices)
        step = dofs.extend(step, jnp.zeros(dofs.size, step.dtype))
        if dofs.frames is not None:
            step = step.at[coordinates].set(dofs.frames.out_of(step[coordinates].reshape(-1, 3)).reshape(-1))
        return step.at[self.face_unknowns].get(mode="fill", fill_value=0.0, wrap_negative_indices=False)

    def vector(
        self,
        faces: Float[Array, "m F"] | None,
        elements: tuple[Float[Array, "_ _ 3"] | None, ...],
        moments: Float[Array, " E"] | None = None,
    ) -> Float[Array, " N"]:
        """Add up the gradients of elements, over all unknowns; `None` for those of a term that is left out.

        **Arguments:**

        - `faces`: derivatives in the unknowns of each face.
        - `elements`: derivatives in the positions of each element, by term.
        - `moments`: that act on free directors, about their edges.
        """
        dofs, coordinates = self.dofs, slice(0, 3 * self.dofs.n_vertices)
        total = jnp.zeros(dofs.size)
        if faces is not None:
            total = total.at[self.face_unknowns].add(faces, mode="drop", wrap_negative_indices=False)
        if elements:
            forces = jnp.zeros((dofs.n_vertices, 3))
            for stencil, gradient in zip(self.stencils, elements, strict=True):
                if gradient is not None:
                    forces = forces.at[stencil].add(gradient)
            total = total.at[coordinates].add(forces.reshape(-1))
        if dofs.frames is not None:
            total = total.at[coordinates].set(dofs.frames.into(total[coordinates].reshape(-1, 3)).reshape(-1))
        if moments is not None:
            assert dofs.director_length is not None  # there are moments on free directors only
            total = total.at[3 * dofs.n_vertices :].add(-moments / dofs.director_length)
        return total

    def matrix(
        self, faces: FaceHessians | None, elements: tuple[Float[Array, "_ _ 3 _ 3"] | None, ...]
    ) -> SparseSymmetric:
        """Add up the Hessians of elements over the free unknowns, `None` for those of a linear term."""
        values = self._blank() if faces is None else self._of_faces(faces.geometric, faces.stiffness())
        return self._operator(self._with_elements(values, elements))

    def lift(
        self, faces: FaceHessians | None, elements: tuple[Float[Array, "_ _ 3 _ 3"] | None, ...]
    ) -> SparseSymmetric:
        """What to add to the matrix of these Hessians so that no element has negative curvature in it."""
        values = self._blank() if faces is None else self._of_faces(-faces.geometric, faces.lift())
        lifts = tuple(None if hessian is None else negative_part(hessian) for hessian in elements)
        return self._operator(self._with_elements(values, lifts))

    def _with_elements(
        self, values: Float[Array, " nnz"], elements: tuple[Float[Array, "_ _ 3 _ 3"] | None, ...]
    ) -> Float[Array, " nnz"]:
        for entries, hessian in zip(self.element_entries, elements, strict=True):
            if entries is not None and hessian is not None:
                values = values.at[entries].add(hessian, mode="drop", wrap_negative_indices=False)
        return values

    def _of_faces(self, geometric: Float[Array, "6 3 3 F"], blocks: Blocks) -> Float[Array, " nnz"]:
        # The half below the diagonal is left out before it is added: adding is what takes the time.
        numbers = jnp.concatenate([block.reshape(-1) for block in (geometric, *blocks) if block is not None])
        added = numbers.at[self.face_numbers].get(mode="promise_in_bounds", wrap_negative_indices=False)
        return self._blank().at[self.face_entries].add(added, wrap_negative_indices=False)

    def _blank(self) -> Float[Array, " nnz"]:
        return jnp.zeros(self.pattern.nnz if self.dofs.frames is None else self.dofs.frames.n_entries)

    def _operator(self, values: Float[Array, " nnz"]) -> SparseSymmetric:
        return SparseSymmetric(self.pattern, values if self.dofs.frames is None else self.dofs.frames.turn(values))


def _check_stencil(name: str, stencil: np.ndarray, mesh: Mesh) -> None:
    if stencil.ndim != 2 or not np.issubdtype(stencil.dtype, np.integer):
        raise ValueError(
            f"{name}.stencil returned an array of shape {stencil.shape} and type {stencil.dtype}; expected integers "
            "of shape (elements, vertices of an element)."
        )
    bad = np.flatnonzero(((stencil < 0) | (stencil >= mesh.n_vertices)).any(axis=1))
    if len(bad):
        raise ValueError(
            f"{name}.stencil: element {bad[0]} names the vertices {stencil[bad[0]].tolist()}, but the mesh has the "
            f"vertices 0 to {mesh.n_vertices - 1}."
        )


def _first_unknown(nodes: np.ndarray, n_vertices: int) -> np.ndarray:
    """The first unknown of each node: three per vertex, then one an edge."""
    return np.where(nodes < n_vertices, 3 * nodes, 2 * n_vertices + nodes)


def _widths(nodes: np.ndarray, n_vertices: int) -> list[int]:
    """How many unknowns each column of a group of elements has; a column holds vertices or edges, not both."""
    return [3 if column.max() < n_vertices else 1 for column in nodes.T]


def _unknowns(nodes: np.ndarray, n_vertices: int) -> np.ndarray:
    """The unknowns of each element, index-last. Those of absent vertices (-1) lie past any last."""
    columns = []
    for node, width in zip(nodes.T, _widths(nodes, n_vertices), strict=True):
        first = _first_unknown(node, n_vertices)
        columns += [np.where(node < 0, np.iinfo(np.int32).max, first + k) for k in range(width)]
    return np.stack(columns).astype(np.int32)


def _entries(groups: list[np.ndarray], held: np.ndarray, n_vertices: int) -> tuple[SymmetricPattern, list[np.ndarray]]:
    """The pattern of all elements together, and the non-zero of each pair of an element's unknowns.

    Pairs below the diagonal, and those of held unknowns or absent vertices, get the index past the last non-zero.
    Repeated pairs are merged node by node before they are spelled out, which keeps large meshes within memory.
    """
    n_nodes = n_vertices + len(held) - 3 * n_vertices
    pairs = [
        np.unique(a[upper].astype(np.int64) * n_nodes + b[upper])
        for nodes in groups
        for a, b, upper in [_node_pairs(nodes)]
    ]
    keys = np.unique(np.concatenate(pairs)) if pairs else np.zeros(0, np.int64)
    left, right = keys // n_nodes, keys % n_nodes
    n = int(np.count_nonzero(~held))
    number = np.where(held, -1, np.cumsum(~held) - 1)
    rows, columns = (
        np.where(
            np.arange(3) < np.where(nodes < n_vertices, 3, 1)[:, None],
            number[np.minimum(_first_unknown(nodes, n_vertices)[:, None] + np.arange(3), len(held) - 1)],
            -1,
        )
        for nodes in (left, right)
    )
    rows, columns = np.broadcast_arrays(rows[:, :, None], columns[:, None, :])
    listed = (rows >= 0) & (columns >= 0) & (rows <= columns)
    pattern, positions = SymmetricPattern.of(rows[listed], columns[listed], n)
    table = np.full(rows.shape, pattern.nnz, np.int32)
    table[listed] = positions

    entries = []
    for nodes in groups:
        a, b, upper = _node_pairs(nodes)
        block = np.searchsorted(keys, a.astype(np.int64) * n_nodes + b)
        widths = _widths(nodes, n_vertices)
        start = np.cumsum([0, *widths])
        entry = np.full((len(nodes), start[-1], start[-1]), pattern.nnz, np.int32)
        for p, rows_of_p in enumerate(widths):
            for q, columns_of_q in enumerate(widths):
                on = upper[:, p, q]
                patch = np.full((len(nodes), rows_of_p, columns_of_q), pattern.nnz, np.int32)
                patch[on] = table[block[on, p, q], :rows_of_p, :columns_of_q]
                entry[:, start[p] : start[p + 1], start[q] : start[q + 1]] = patch
        entries.append(entry)
    return pattern, entries


def _face_entries(entries: np.ndarray, dropped: int) -> list[np.ndarray]:
    """The non-zeros of the geometric part of a face's Hessian and of its blocks, index-last, from those of all pairs of
    its unknowns."""
    m = entries.shape[1]
    index_last = lambda block: np.ascontiguousarray(np.moveaxis(block, 0, -1))
    either = lambda block, mirrored: np.where(block < dropped, block, mirrored)
    corners = entries[:, :9, :9]
    symmetric = either(corners, np.swapaxes(corners, 1, 2)).reshape(-1, 3, 3, 3, 3)
    geometric = np.stack([symmetric[:, p, :, q, :] for p, q in CORNER_PAIRS], axis=1)
    for k, (p, q) in enumerate(CORNER_PAIRS):
        if p == q:
            geometric[:, k, *np.tril_indices(3, -1)] = dropped
    blocks = [index_last(geometric), index_last(corners)]
    if m > 9:
        # What a hinge alone moves with: the coordinates of the vertex beyond, and its director where it has one.
        own = np.stack([np.r_[9 + 3 * k : 12 + 3 * k, 18 + k : min(m, 19 + k)] for k in range(3)])
        blocks.append(index_last(either(entries[:, own, :9], np.moveaxis(entries[:, :9][:, :, own], 1, -1))))
        blocks.append(index_last(entries[:, own][:, :, :, own]))
    return blocks


def _node_pairs(nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First and second node of all pairs within each element, and which of them are present and in the upper
    triangle."""
    a, b = np.broadcast_arrays(nodes[:, :, None], nodes[:, None, :])
    return a, b, (a >= 0) & (b >= 0) & (a <= b)
