"""Motions that cost nothing: the null space of a Hessian that is known beforehand, and how to solve in spite of it.

As many coordinates are held as there are free motions, which makes the matrix regular without changing the minimum;
and the
free motions are projected out of right-hand side and solution, which then is that of the pseudo-inverse.
"""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .operator import SparseSymmetric


def orthonormal(motions: Float[Array, "n k"]) -> Float[Array, "n k"]:
    """An orthonormal basis of the given motions."""
    return jnp.linalg.qr(motions)[0]


def project_out(basis: Float[Array, "n k"] | None, vector: Float[Array, " n"]) -> Float[Array, " n"]:
    """The part of a vector orthogonal to an orthonormal basis; all of it if there is no basis."""
    return vector if basis is None else vector - basis @ (basis.T @ vector)


def coordinates_to_hold(basis: Float[Array, "n k"]) -> Int[Array, " k"]:
    """One coordinate for each motion, such that no combination of the motions leaves them all in place.

    Greedy pivoting: hold the coordinate that moves most, then go on with the motions that leave it in place.
    """
    held = []
    for _ in range(basis.shape[1]):
        coordinate = jnp.argmax(jnp.sum(basis**2, axis=1))
        direction = basis[coordinate] / jnp.linalg.norm(basis[coordinate])
        basis = basis - jnp.outer(basis @ direction, direction)
        held.append(coordinate)
    return jnp.stack(held)


def hold(operator: Any, coordinates: Int[Array, " k"]) -> Any:
    """The operator with rows and columns of some coordinates cleared, and a typical number on their diagonal."""
    if not isinstance(operator, SparseSymmetric):
        return operator.holding(coordinates)
    pattern = operator.pattern
    keep = jnp.ones(pattern.n).at[coordinates].set(0.0)
    values = operator.values * keep[pattern.rows] * keep[pattern.indices]
    return SparseSymmetric(pattern, values.at[pattern.diagonal[coordinates]].set(operator.size_of_diagonal()))
