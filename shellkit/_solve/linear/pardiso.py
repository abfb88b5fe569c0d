"""MKL PARDISO through pardiso-mkl-jax: LDLᵀ of an indefinite matrix, with its inertia. x86-64 only.

The library keeps factors in a cache under 64-bit keys that travel through JAX as data. It would derive the keys from
the content of a matrix, one byte at a time, which costs as much as a small factorisation; here the key names the
pattern, so that one analysis serves every matrix of that pattern, in every compiled function, and its numeric factor is
overwritten in place. A solve therefore checks its residual: if another matrix has been factorised since, its own is
done again."""

import functools
import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from types import ModuleType
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, UInt64

from ..._citation.papers import SCHENK_2004
from ..matrices.operator import SparseSymmetric, symmetric_product
from ..matrices.pattern import SymmetricPattern
from .base import AbstractDirectSolver, Factor, balanced, check_rhs, guarded, require_float64


_SYMMETRIC_INDEFINITE = -2
_POSITIVE, _NEGATIVE, _PERTURBED = 21, 22, 13  # entries of PARDISO's iparm, counted from zero
_DEFAULTS = {
    1: 2,  # nested dissection by METIS
    7: 0,  # no iterative refinement
    9: 15,  # pivots below 1e-15 of the matrix are replaced, and counted
    23: 1,  # two-level scheduling, for several threads
    20: 0,  # pivots are single: a third faster than in pairs, and definite matrices need no more
}
Options = tuple[tuple[int, int], ...]
# A factor of the right matrix leaves a residual of a few roundings; one of another matrix does not.
_BACKWARD_ERROR = 1e-13


class Pardiso(AbstractDirectSolver):
    """Sparse LDLᵀ by MKL PARDISO. The solver of choice on x86-64; reports the inertia.

    Pivots are single entries of the diagonal, which is fastest and right for definite matrices; one that is lost to
    rounding is counted, and the factor not `ok`. `Pardiso({20: 1})` pivots as Bunch and Kaufman do, for indefinite
    matrices.

    It runs on one thread, as its threads wait for each other in busy loops. On two cores a design step at 1400 vertices
    took 115 to 245 ms with two of them and 165 to 220 ms with one, from run to run; at 642 vertices, beside other work
    on the same cores, 180 and 60 ms. To have more, set `MKL_NUM_THREADS` in the environment.

    ??? cite "Reference"
        O. Schenk, K. Gärtner, *Solving unsymmetric sparse systems of linear equations with PARDISO*, Future Generation
        Computer Systems 20 (2004) 475–487.
    """

    papers: ClassVar[tuple[str, ...]] = (SCHENK_2004,)
    options: Options = eqx.field(static=True)

    def __init__(self, options: Mapping[int, int] | None = None):
        """**Arguments:**

        - `options`: entries of PARDISO's `iparm` (counted from zero) that replace the defaults chosen here.
        """
        self.options = tuple(sorted({**_DEFAULTS, **(options or {})}.items()))

    def factorise(self, operator: SparseSymmetric) -> Factor:
        # The library's call for the factorisation alone would hash the matrix and move the analysis to a new key.
        return self.factorise_and_solve(operator, jnp.ones(operator.pattern.n, operator.values.dtype))[0]

    def factorise_and_solve(
        self, operator: SparseSymmetric, rhs: Float[Array, "n"]
    ) -> tuple[Factor, Float[Array, "n"]]:
        require_float64("PARDISO", operator.values)
        pattern = operator.pattern
        values, finite = guarded(pattern, jax.lax.stop_gradient(operator.values))
        key = _key(pattern, self.options)
        values, scale = balanced(pattern, values)
        solution, iparm = _factorise(self.options)(key, pattern, values, scale * jax.lax.stop_gradient(rhs))
        # The key depends on what the library returned, so that no solve is scheduled before the factorisation.
        key = key + (iparm[0] < 0).astype(key.dtype)
        negative = jnp.where(finite, iparm[_NEGATIVE], -1)
        # Sums are finite where all of their terms are.
        solved, asked = jnp.isfinite(jnp.sum(jnp.stack([solution, rhs]), axis=1))
        solvable = solved | ~asked
        ok = finite & solvable & (iparm[_PERTURBED] == 0)
        return Factor(pattern, values, (key, scale), negative, ok), scale * solution

    def solve(self, factor: Factor, rhs: Float[Array, "*k n"], checked: bool = True) -> Float[Array, "*k n"]:
        check_rhs(factor, rhs)
        stacked = jnp.atleast_2d(jax.lax.stop_gradient(rhs))
        solve = _solve(self.options, checked)
        key, scale = factor.token
        return scale * solve(key, factor.pattern, factor.values, scale * stacked).reshape(rhs.shape)


_THREAD_VARIABLES = ("MKL_NUM_THREADS", "MKL_DOMAIN_NUM_THREADS", "OMP_NUM_THREADS")
_MKL_DOMAIN_PARDISO = 4


@functools.cache
def _library() -> ModuleType:
    """The library's calls, on one thread unless the environment says otherwise.

    MKL's threads wait for each other in busy loops: on a machine that anything else runs on, two of them were up to
    seven times slower than one at 642 vertices.
    """
    from pardiso_mkl_jax import _mkl_loader, primitive

    if not any(variable in os.environ for variable in _THREAD_VARIABLES):
        _mkl_loader.libmkl_rt.MKL_Domain_Set_Num_Threads(1, _MKL_DOMAIN_PARDISO)
    return primitive


def _key(pattern: SymmetricPattern, options: Options) -> UInt64[Array, "..."]:
    """What the library files the factor of this pattern under. Different options are different factors."""
    salt = int.from_bytes(hashlib.blake2b(repr(options).encode(), digest_size=8).digest(), "little")
    low, high = pattern.fingerprint[..., 0], pattern.fingerprint[..., 1]
    return (low.astype(jnp.uint64) | (high.astype(jnp.uint64) << jnp.uint64(32))) ^ jnp.uint64(salt)


def _call(
    phases: str,
    options: Options,
    key: UInt64[Array, ""],
    pattern: SymmetricPattern,
    values: Float[Array, " nnz"],
    rhs: Float[Array, "k n"],
) -> tuple[Float[Array, "k n"], Int[Array, " _"]]:
    """One of the library's stateful calls, under our own key: the solution, the final iparm."""
    primitive = _library()
    token = primitive.FactorizationToken(key, jnp.zeros((), jnp.int32))
    solution, iparm, _ = getattr(primitive, phases)(
        token, pattern.indptr, pattern.indices, values, rhs, matrix_type=_SYMMETRIC_INDEFINITE, options=options
    )
    return solution, iparm


@functools.cache
def _factorise(options: Options) -> Callable[..., tuple[Array, Array]]:
    """The factorisation with these options, of one matrix at a time: the solution and the final iparm."""

    @jax.custom_batching.sequential_vmap
    def factorise(
        key: UInt64[Array, ""], pattern: SymmetricPattern, values: Float[Array, " nnz"], rhs: Float[Array, " n"]
    ) -> tuple[Float[Array, " n"], Int[Array, " _"]]:
        solution, iparm = _call("factor_and_solve_stateful", options, key, pattern, values, rhs[None])
        return solution[0], iparm

    return factorise


@functools.cache
def _solve(options: Options, checked: bool) -> Callable[..., Array]:
    """The solution with a factor made with these options, for k right-hand sides."""

    @jax.custom_batching.sequential_vmap
    def each(
        key: UInt64[Array, ""], pattern: SymmetricPattern, values: Float[Array, " nnz"], rhs: Float[Array, "k n"]
    ) -> Float[Array, "k n"]:
        solution, _ = _call("solve_stateful", options, key, pattern, values, rhs)
        # One product checks all of them: their sum, each brought to size one.
        sizes = jnp.max(jnp.abs(solution), axis=1)
        weights = 1 / jnp.where(sizes > 0, sizes, 1)
        residual = symmetric_product(pattern, values, weights @ solution) - weights @ rhs
        scale = jnp.max(jnp.abs(values)) * rhs.shape[0] + jnp.max(weights @ jnp.abs(rhs))
        ours = jnp.max(jnp.abs(residual)) <= _BACKWARD_ERROR * scale
        return jax.lax.cond(
            ours,
            lambda: solution,
            lambda: _call("factor_and_solve_stateful", options, key, pattern, values, rhs)[0],
        )

    @jax.custom_batching.custom_vmap
    def solve(
        key: UInt64[Array, ""], pattern: SymmetricPattern, values: Float[Array, " nnz"], rhs: Float[Array, "k n"]
    ) -> Float[Array, "k n"]:
        if checked:
            return each(key, pattern, values, rhs)
        return _call("solve_stateful", options, key, pattern, values, rhs)[0]

    @solve.def_vmap
    def _(
        axis_size: int,
        batched: Sequence[Any],
        key: UInt64[Array, "..."],
        pattern: SymmetricPattern,
        values: Float[Array, "... nnz"],
        rhs: Float[Array, "... k n"],
    ) -> tuple[Float[Array, "b k n"], Any]:
        *matrix_batched, rhs_batched = batched
        if not any(jax.tree_util.tree_leaves(matrix_batched)):
            stacked = solve(key, pattern, values, rhs.reshape(-1, rhs.shape[-1]))
            return stacked.reshape(rhs.shape), rhs_batched
        # Of the matrices of a batch the last one's factor is left: the others are checked in any case.
        axes = jax.tree_util.tree_map(lambda is_batched: 0 if is_batched else None, tuple(batched))
        return jax.vmap(each, in_axes=axes, axis_size=axis_size)(key, pattern, values, rhs), True

    return solve
