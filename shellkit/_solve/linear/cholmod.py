"""SuiteSparse CHOLMOD through sparsax: Cholesky factors of positive definite matrices, on Linux and macOS, any
processor.

The library finds a factor by the content of its matrix: it analyses a new pattern, factorises new values, and otherwise
goes straight to the solution, so no factor can be mistaken for another. It raises where a matrix is not positive
definite, which nothing inside a compiled function can catch; the factorisation is therefore called from the host."""

import functools
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._citation.papers import CHEN_2008
from ..matrices.operator import SparseSymmetric
from .base import AbstractDirectSolver, Factor, check_rhs, guarded, identity_unless, require_float64


class Cholmod(AbstractDirectSolver):
    """Sparse Cholesky by CHOLMOD. For positive definite matrices only: a matrix that is not gets `ok = False`, and
    `negative = -1`, since how far it is from being one is not known.

    ??? cite "Reference"
        Y. Chen, T. A. Davis, W. W. Hager, S. Rajamanickam, *Algorithm 887: CHOLMOD, supernodal sparse Cholesky
        factorization and update/downdate*, ACM Transactions on Mathematical Software 35 (2008) 22.
    """

    papers: ClassVar[tuple[str, ...]] = (CHEN_2008,)

    def factorise(self, operator: SparseSymmetric) -> Factor:
        require_float64("CHOLMOD", operator.values)
        pattern = operator.pattern
        values, finite = guarded(pattern, jax.lax.stop_gradient(operator.values))
        definite = jax.pure_callback(
            functools.partial(_is_definite, pattern.n),
            jax.ShapeDtypeStruct((), jnp.bool_),
            pattern.rows,
            pattern.indices,
            values,
            vmap_method="sequential",
        )
        values = identity_unless(definite, pattern, values)
        ok = finite & definite
        return Factor(pattern, values, (), jnp.where(ok, 0, -1), ok)

    def factorise_and_solve(
        self, operator: SparseSymmetric, rhs: Float[Array, "n"]
    ) -> tuple[Factor, Float[Array, "n"]]:
        factor = self.factorise(operator)
        return factor, self.solve(factor, rhs)

    def solve(self, factor: Factor, rhs: Float[Array, "*k n"], checked: bool = True) -> Float[Array, "*k n"]:
        import sparsax

        check_rhs(factor, rhs)
        rows, columns = factor.pattern.rows, factor.pattern.indices
        return sparsax.solve(rows, columns, factor.values, jax.lax.stop_gradient(rhs).T).T


def _is_definite(n: int, rows, columns, values) -> np.ndarray:
    """Whether CHOLMOD factorises the matrix. The factor stays in its cache, where the solution will find it."""
    try:
        return np.asarray(np.isfinite(_log_determinant(n)(*map(np.asarray, (rows, columns, values)))))
    except (ValueError, jax.errors.JaxRuntimeError) as error:
        if "not positive definite" not in str(error):
            raise
        return np.asarray(False)


@functools.cache
def _log_determinant(n: int):
    import sparsax

    return jax.jit(functools.partial(sparsax.logdet, n=n))
