"""Vertices whose coordinates are counted in a frame of their own: those held in directions that are no axes of
space."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..._programs.tracing import known
from ..._solve.matrices.pattern import SymmetricPattern


class Frames(eqx.Module):
    """The frames of some vertices, and how a Hessian is turned into them.

    A Hessian is first assembled in the axes of space, with all three coordinates of these vertices; then the blocks
    that concern them are turned, and the held rows and columns left out.
    """

    vertices: Int[Array, " k"]
    axes: Float[Array, "k 3 3"]  # as rows
    blocks: Int[Array, "b 3 3"]  # the non-zeros of each block to turn; past the last where there is none
    left: Int[Array, " b"]  # the frames on both sides of a block; k for that of space
    right: Int[Array, " b"]
    kept: Int[Array, " nnz"]
    n_entries: int = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        vertices: Int[np.ndarray, " k"],
        axes: Float[np.ndarray, "k 3 3"],
        whole: SymmetricPattern,
        listed: Int[np.ndarray, " n"],
        held: Bool[np.ndarray, " N"],
        n_vertices: int,
    ) -> tuple["Frames", SymmetricPattern]:
        """The frames, and the pattern of the Hessian in them.

        **Arguments:**

        - `vertices`, `axes`: the frames.
        - `whole`: the pattern before anything is turned.
        - `listed`: the unknown of each of its rows.
        - `held`: which of all unknowns are held, in their frames.
        - `n_vertices`: of the mesh.
        """
        rows, columns = listed[np.asarray(whole.rows)], listed[np.asarray(whole.indices)]
        keep = ~held[rows] & ~held[columns]
        number = np.cumsum(~held) - 1
        pattern, _ = SymmetricPattern.of(number[rows[keep]], number[columns[keep]], int(np.count_nonzero(~held)))

        frame = np.full(n_vertices + len(held) - 3 * n_vertices, len(vertices))
        frame[vertices] = np.arange(len(vertices))
        on_vertex = lambda unknown: unknown < 3 * n_vertices
        node = lambda unknown: np.where(on_vertex(unknown), unknown // 3, unknown - 2 * n_vertices)
        axis = lambda unknown: np.where(on_vertex(unknown), unknown % 3, 0)
        nodes = np.stack([node(rows), node(columns)], axis=1)
        entries = np.flatnonzero((frame[nodes] < len(vertices)).any(axis=1))
        pairs, block = np.unique(nodes[entries], axis=0, return_inverse=True)
        blocks = np.full((len(pairs), 3, 3), whole.nnz, np.int32)
        blocks[block, axis(rows[entries]), axis(columns[entries])] = entries
        own = pairs[:, 0] == pairs[:, 1]
        blocks[own] = np.minimum(blocks[own], np.swapaxes(blocks[own], 1, 2))
        as_indices = lambda a: known(a.astype(np.int32))
        left, right = frame[pairs].T
        return cls(
            vertices=as_indices(vertices),
            axes=known(axes),
            blocks=as_indices(blocks),
            left=as_indices(left),
            right=as_indices(right),
            kept=as_indices(np.flatnonzero(keep)),
            n_entries=whole.nnz,
        ), pattern

    def into(self, vectors: Float[Array, "V 3"]) -> Float[Array, "V 3"]:
        """Vectors at the vertices, from space's axes to their own."""
        return vectors.at[self.vertices].set(jnp.einsum("kij,kj->ki", self.axes, vectors[self.vertices]))

    def out_of(self, vectors: Float[Array, "V 3"]) -> Float[Array, "V 3"]:
        """Vectors at the vertices, from their own axes to space's."""
        return vectors.at[self.vertices].set(jnp.einsum("kij,ki->kj", self.axes, vectors[self.vertices]))

    def turn(self, values: Float[Array, " whole"]) -> Float[Array, " nnz"]:
        """The values of a Hessian in the frames, from those in the axes of space."""
        axes = jnp.concatenate([self.axes, jnp.eye(3, dtype=values.dtype)[None]])
        blocks = values.at[self.blocks].get(mode="fill", fill_value=0.0)
        blocks = axes[self.left] @ blocks @ jnp.swapaxes(axes[self.right], 1, 2)
        return values.at[self.blocks].set(blocks, mode="drop")[self.kept]
