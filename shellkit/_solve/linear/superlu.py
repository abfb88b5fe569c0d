"""SuperLU through SciPy, called from the host: slow, but there wherever SciPy is.

With pivots kept on the diagonal, LU of a symmetric matrix is LDLᵀ with D the diagonal of U, so its signs are the
inertia. Factors live in a small cache of this process, under numbers that travel through JAX; one that fell out is made
again."""

import itertools
from collections import OrderedDict
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._citation.papers import DEMMEL_1999
from ..matrices.operator import SparseSymmetric
from .base import AbstractDirectSolver, Factor, balanced, check_rhs, guarded, require_float64


_LOST_PIVOT = 1e-13  # relative to the largest entry, as PARDISO has it
_CACHED = 8


class SuperLU(AbstractDirectSolver):
    """Sparse LU with diagonal pivots by SuperLU. The fallback where no other library is installed; reports the inertia.

    ??? cite "Reference"
        J. W. Demmel, S. C. Eisenstat, J. R. Gilbert, X. S. Li, J. W. H. Liu, *A supernodal approach to sparse partial
        pivoting*, SIAM Journal on Matrix Analysis and Applications 20 (1999) 720–755.
    """

    papers: ClassVar[tuple[str, ...]] = (DEMMEL_1999,)

    def factorise(self, operator: SparseSymmetric) -> Factor:
        require_float64("SuperLU", operator.values)
        pattern = operator.pattern
        values, finite = guarded(pattern, jax.lax.stop_gradient(operator.values))
        values, scale = balanced(pattern, values)
        token, negative, ok = jax.pure_callback(
            _factorise,
            (
                jax.ShapeDtypeStruct((), jnp.int32),
                jax.ShapeDtypeStruct((), jnp.int32),
                jax.ShapeDtypeStruct((), jnp.bool_),
            ),
            pattern.fingerprint,
            pattern.indptr,
            pattern.indices,
            values,
            vmap_method="sequential",
        )
        return Factor(pattern, values, (token, scale), jnp.where(finite, negative, -1), finite & ok)

    def factorise_and_solve(
        self, operator: SparseSymmetric, rhs: Float[Array, "n"]
    ) -> tuple[Factor, Float[Array, "n"]]:
        factor = self.factorise(operator)
        return factor, self.solve(factor, rhs)

    def solve(self, factor: Factor, rhs: Float[Array, "*k n"], checked: bool = True) -> Float[Array, "*k n"]:
        check_rhs(factor, rhs)
        pattern = factor.pattern
        token, scale = factor.token
        return scale * jax.pure_callback(
            _solve,
            jax.ShapeDtypeStruct(rhs.shape, rhs.dtype),
            token,
            pattern.fingerprint,
            pattern.indptr,
            pattern.indices,
            factor.values,
            scale * jax.lax.stop_gradient(rhs),
            vmap_method="sequential",
        )


class _Analysis(NamedTuple):
    """The pattern of the whole matrix in a fill-reducing order, by columns, and where each entry comes from."""

    order: np.ndarray
    indptr: np.ndarray
    indices: np.ndarray
    positions: np.ndarray


class _Cache:
    """The few things used last, by their keys."""

    def __init__(self):
        self.entries: OrderedDict[Any, Any] = OrderedDict()

    def get(self, key):
        found = self.entries.pop(key, None)
        if found is not None:
            self.entries[key] = found
        return found

    def put(self, key, entry):
        self.entries[key] = entry
        while len(self.entries) > _CACHED:
            self.entries.popitem(last=False)


_analyses = _Cache()
_factors = _Cache()
_tokens = itertools.count()


def _analyse(fingerprint, indptr, indices) -> _Analysis:
    key = tuple(np.asarray(fingerprint).tolist())
    analysis = _analyses.get(key)
    if analysis is None:
        analysis = _order(np.asarray(indptr), np.asarray(indices))
        _analyses.put(key, analysis)
    return analysis


def _order(indptr: np.ndarray, indices: np.ndarray) -> _Analysis:
    """Minimum degree on the whole pattern, read off SuperLU's factor of a matrix that certainly has one."""
    from scipy.sparse import csc_matrix

    n = len(indptr) - 1
    rows = np.repeat(np.arange(n), np.diff(indptr))
    strict = np.flatnonzero(rows != indices)
    positions = np.concatenate([np.arange(len(indices)), strict])
    rows, columns = np.concatenate([rows, indices[strict]]), np.concatenate([indices, rows[strict]])
    dominant = csc_matrix((np.where(rows == columns, len(indices), 1.0), (rows, columns)), shape=(n, n))
    place = _splu(dominant, "MMD_AT_PLUS_A").perm_c
    rows, columns = place[rows], place[columns]
    sort = np.lexsort((rows, columns))
    starts = np.searchsorted(columns[sort], np.arange(n + 1)).astype(np.int32)
    return _Analysis(np.argsort(place), starts, rows[sort].astype(np.int32), positions[sort])


def _splu(matrix, ordering: str):
    from scipy.sparse.linalg import splu

    return splu(matrix, permc_spec=ordering, diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def _decompose(analysis: _Analysis, values: np.ndarray):
    from scipy.sparse import csc_matrix

    n = len(analysis.order)
    return _splu(csc_matrix((values[analysis.positions], analysis.indices, analysis.indptr), shape=(n, n)), "NATURAL")


def _factorise(fingerprint, indptr, indices, values):
    analysis, values = _analyse(fingerprint, indptr, indices), np.asarray(values)
    token = next(_tokens) % 2**31
    try:
        factor = _decompose(analysis, values)
    except RuntimeError:  # exactly singular
        return np.int32(token), np.int32(-1), np.asarray(False)
    _factors.put(token, factor)
    pivots = factor.U.diagonal()
    kept = np.min(np.abs(pivots)) > _LOST_PIVOT * np.max(np.abs(values))
    diagonal = np.array_equal(factor.perm_r, factor.perm_c)
    negative = np.count_nonzero(pivots < 0) if diagonal else -1
    return np.int32(token), np.int32(negative), np.asarray(kept and np.all(np.isfinite(pivots)))


def _solve(token, fingerprint, indptr, indices, values, rhs) -> np.ndarray:
    analysis, values, rhs = _analyse(fingerprint, indptr, indices), np.asarray(values), np.asarray(rhs)
    factor = _factors.get(int(token))
    if factor is None:
        try:
            factor = _decompose(analysis, values)
        except RuntimeError:
            return np.full_like(rhs, np.nan)
        _factors.put(int(token), factor)
    solution = np.empty_like(rhs)
    solution[..., analysis.order] = factor.solve(np.ascontiguousarray(rhs[..., analysis.order].T)).T
    return solution
