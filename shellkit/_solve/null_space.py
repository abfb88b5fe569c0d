"""Motions that cost nothing: the null space of a Hessian that is known beforehand, and how to solve in spite of it.

As many coordinates as there are free motions are held by springs, which makes the matrix regular without changing the
minimum; and the free motions are projected out of right-hand side and solution, which then is that of the
pseudo-inverse.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .linear.base import Factor
from .linear.bordered import Bordered, BorderedFactor
from .matrices.operator import SparseSymmetric


_ABSENT = 1e-20  # the square of how far the coordinate that moves most does, if none does


Operator = TypeVar("Operator", SparseSymmetric, Bordered)


def orthonormal(motions: Float[Array, "n k"]) -> Float[Array, "n k"]:
    """An orthonormal basis of the given motions, from their products with each other; twice, for the sake of rounding.
    Motions that are zero leave as many zeros in it.

    Without LAPACK on long arrays: on a CPU its threads would spin for some 20 ms after a factorisation, on the cores
    that all else needs. A relaxation took a fifth longer.
    """

    def improve(_, basis):
        sizes = jnp.sum(basis**2, axis=0)
        basis = basis * _inverse_root(sizes)
        sizes, axes = jnp.linalg.eigh(basis.T @ basis)
        return basis @ (axes * _inverse_root(sizes))

    return jax.lax.fori_loop(0, 2, improve, motions)


def _inverse_root(sizes: Float[Array, " k"]) -> Float[Array, " k"]:
    """One over the root; zero for an absent motion."""
    there = sizes > 1e-14 * jnp.max(sizes)
    return jnp.where(there, jax.lax.rsqrt(jnp.where(there, sizes, 1.0)), 0.0)


def project_out(basis: Float[Array, "n k"] | None, vector: Float[Array, " n"]) -> Float[Array, " n"]:
    """The part of a vector orthogonal to an orthonormal basis; all of it if there is no basis."""
    return vector if basis is None else vector - basis @ (basis.T @ vector)


def pseudo_inverse_solve(
    linear_solver: Any,
    factor: Factor | BorderedFactor,
    basis: Float[Array, "n k"] | None,
    rhs: Float[Array, " n"],
    checked: bool = True,
) -> Float[Array, " n"]:
    """Apply the pseudo-inverse, off the motions in `basis`, by the factor of a matrix with springs on as many
    coordinates.

    **Arguments:**

    - `linear_solver`: that made the factor: of sparse matrices, or of bordered ones.
    - `factor`, `basis`: the factor, and an orthonormal basis of the motions that cost nothing; `None` without any.
    - `rhs`: the right-hand side.
    - `checked`: see [`AbstractSparseSolver.solve`][].
    """
    return project_out(basis, linear_solver.solve(factor, project_out(basis, rhs), checked))


def gauge_coordinates(basis: Float[Array, "n k"]) -> Int[Array, " k"]:
    """One coordinate for each motion, such that no combination of the motions leaves them all in place.

    Greedy pivoting: hold the coordinate that moves most, then go on with the motions that leave it in place. For a
    motion that is absent it is the one past the last.
    """

    def hold(k, carry):
        sizes, held, directions = carry
        coordinate = jnp.argmax(sizes)
        absent = sizes[coordinate] <= _ABSENT
        direction = basis[coordinate]
        direction = direction - directions.T @ (directions @ direction)
        direction = jnp.where(absent, 0.0, direction / jnp.linalg.norm(direction))
        sizes = sizes - (basis @ direction) ** 2
        return sizes, held.at[k].set(jnp.where(absent, len(basis), coordinate)), directions.at[k].set(direction)

    count = basis.shape[1]
    start = (jnp.sum(basis**2, axis=1), jnp.zeros(count, int), jnp.zeros((count, count), basis.dtype))
    return jax.lax.fori_loop(0, count, hold, start)[1]


def gauged_hessian(
    operator: Operator, motions: Callable[[Array], Array] | None, y: Float[Array, " n"]
) -> tuple[Operator, Float[Array, "n k"] | None, Int[Array, " k"] | None]:
    """The operator with springs on as many coordinates as motions cost nothing at `y`, an orthonormal basis of these,
    and the coordinates; without motions the operator as it is."""
    if motions is None:
        return operator, None, None
    basis = orthonormal(motions(y))
    held = gauge_coordinates(basis)
    # Or what makes the matrix would be compiled into each use of it, and done twice.
    operator = jax.lax.optimization_barrier(operator)
    return operator.gauged(held, operator.size_of_diagonal()), basis, held
