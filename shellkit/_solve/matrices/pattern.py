"""Where the non-zeros of a sparse symmetric matrix lie.

Only the upper triangle is kept, row by row. The pattern is found once on the host, in numpy; from then on it is a
pytree of index arrays that matrices of changing values share."""

import hashlib

import equinox as eqx
import numpy as np
from jaxtyping import Array, Int32, UInt32

from ..._programs.tracing import known


class SymmetricPattern(eqx.Module):
    """The sparsity of a symmetric $n \\times n$ matrix: its upper triangle in compressed rows, columns ascending.

    Every diagonal entry is present, whether or not it was asked for, so that a multiple of the identity can always be
    added. Build it with [`SymmetricPattern.of`][].
    """

    indptr: Int32[Array, "n_plus_1"]
    indices: Int32[Array, "nnz"]
    rows: Int32[Array, "nnz"]
    diagonal: Int32[Array, "n"]
    fingerprint: UInt32[Array, "2"]

    @staticmethod
    def of(rows, columns, n: int) -> tuple["SymmetricPattern", Int32[np.ndarray, "pairs"]]:
        """The pattern that holds all the given entries, and where each of them went.

        **Arguments:**

        - `rows`, `columns`: integer numpy arrays of one length, the indices of the entries. The order does not matter,
            repeated pairs share one non-zero, and $(i, j)$ is the same entry as $(j, i)$.
        - `n`: the size of the matrix.

        **Returns:**

        The pattern, and for each pair the position of its non-zero, as an int32 numpy array. The values of a matrix
        assembled from contributions `c` are `jnp.zeros(pattern.nnz).at[positions].add(c)`, as long as an off-diagonal
        contribution is listed for one of $(i, j)$ and $(j, i)$ only.

        **Raises:**

        `ValueError` if the index arrays differ in shape or an index is outside $0 \\ldots n - 1$.
        """
        rows, columns = np.asarray(rows), np.asarray(columns)
        if rows.ndim != 1 or rows.shape != columns.shape:
            raise ValueError(
                f"rows and columns must be vectors of one length, not of shapes {rows.shape} and {columns.shape}"
            )
        rows, columns = rows.astype(np.int64), columns.astype(np.int64)
        outside = (rows < 0) | (rows >= n) | (columns < 0) | (columns >= n)
        if outside.any():
            k = int(np.argmax(outside))
            raise ValueError(f"pair {k} is ({rows[k]}, {columns[k]}), outside a matrix of size {n}")
        keys = np.minimum(rows, columns) * n + np.maximum(rows, columns)
        diagonal = np.arange(n, dtype=np.int64) * (n + 1)
        entries, positions = np.unique(np.concatenate([diagonal, keys]), return_inverse=True)
        upper_rows, indices = entries // max(n, 1), entries % max(n, 1)
        indptr = np.searchsorted(upper_rows, np.arange(n + 1)).astype(np.int32)
        indices = indices.astype(np.int32)
        digest = hashlib.blake2b(indptr.tobytes() + indices.tobytes(), digest_size=8).digest()
        pattern = SymmetricPattern(
            indptr=known(indptr),
            indices=known(indices),
            rows=known(upper_rows.astype(np.int32)),
            diagonal=known(positions[:n].astype(np.int32)),
            fingerprint=known(np.frombuffer(digest, np.uint32)),
        )
        return pattern, positions[n:].astype(np.int32)

    @property
    def n(self) -> int:
        """The size of the matrix."""
        return self.diagonal.shape[-1]

    @property
    def nnz(self) -> int:
        """How many entries the upper triangle holds, the diagonal included."""
        return self.indices.shape[-1]
