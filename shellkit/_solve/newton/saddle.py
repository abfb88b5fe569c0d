"""The way off a saddle."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Scalar


_INVERSE_ITERATIONS, _LOBPCG_STEPS = 8, 16
_BALANCE = 1e-6  # forces below this part of what the softest step would raise are those of a saddle
_DEPENDENT = 1e-12  # directions of length one that span no more than this are one
_SLOPE = 1e-3  # along a direction of negative curvature, a slope below this part of it is rounding


def away_from_saddle(
    product: Callable[[Array], Array], solve: Callable[[Array], Array], gradient: Float[Array, " n"], length: Scalar
) -> Float[Array, " n"]:
    """A step off a saddle: along the softest direction of the convex model, by inverse iteration with its factor; or,
    where that is stable, along the lowest direction of the Hessian, if forces balance, or if the energy falls along it
    by more than it would rise along the softest.

    A shell buckles along its soft modes. What is unstable, but stiffer, while forces are out of balance is often stable
    where they lead, and ends in crumpled states. The step goes downhill; where both ways do, it is always the same
    one, so that problems that differ by little stay on one branch.

    **Arguments:**

    - `product`: with the Hessian.
    - `solve`: with the matrix that was made convex and factorised.
    - `gradient`: where the step begins.
    - `length`: the largest entry of the step.
    """
    softest, lowest = _soft_and_low(product, solve, _spread(gradient))
    # Both with their products by the Hessian.
    softest, lowest = (length / jnp.max(jnp.abs(way[0])) * way for way in (softest, lowest))
    rise, fall = softest[0] @ softest[1], -(lowest[0] @ lowest[1])
    balanced = jnp.linalg.norm(gradient) * jnp.linalg.norm(softest[0]) < _BALANCE * rise
    step, image = jnp.where((rise > 0) & (balanced | (fall > rise)), lowest, softest)
    uphill = gradient @ step > _SLOPE * jnp.maximum(-(step @ image), 0.0)
    return jnp.where(uphill, -step, step)


def _spread(like: Float[Array, " n"]) -> Float[Array, " n"]:
    """A vector with a part in every direction: the same each time, and cheaper to compile than random numbers."""
    return jnp.sin(jnp.arange(1.0, len(like) + 1.0, dtype=like.dtype) ** 2)


def _soft_and_low(
    product: Callable[[Array], Array], solve: Callable[[Array], Array], start: Float[Array, " n"]
) -> tuple[Float[Array, "2 n"], Float[Array, "2 n"]]:
    """The softest direction of M, the matrix that `solve` solves with, and the lowest of v.Hv over v.Mv (of H alone it
    would be the shortest wave), each with its product by H. The latter is looked for only where the energy rises along
    the former.

    Inverse iterations come first, then steps of the locally optimal method from the same start. One loop does both, so
    that `solve` and `product` are compiled once.

    ??? cite "Source"
        A. Knyazev, *Toward the optimal preconditioned eigensolver*, SIAM J. Sci. Comput. 23 (2001) 517-541, for one
        vector.
    """

    def improve(carry):
        # The vector and the last step, each with its products by H and by M, as rows.
        k, kept, softest, _ = carry
        vector, curved, weighed = kept[0]
        curvature = (vector @ curved) / (vector @ weighed)
        inverse = k <= _INVERSE_ITERATIONS
        rhs = jnp.where(inverse, jnp.where(k == _INVERSE_ITERATIONS, start, vector), curved - curvature * weighed)
        ahead = solve(rhs)
        trial = jnp.concatenate([kept, jnp.stack([ahead, product(ahead), rhs])[None]])
        sizes = jnp.abs(jnp.sum(trial[:, 0] * trial[:, 2], axis=1))
        trial = trial * jnp.where(sizes > 0, jax.lax.rsqrt(jnp.where(sizes > 0, sizes, 1.0)), 0.0)[:, None, None]
        steps = jnp.where(inverse, jnp.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]), _best_mixture(trial))
        kept = jnp.tensordot(steps, trial, 1)
        softest = jnp.where(k < _INVERSE_ITERATIONS, kept[0, :2], softest)
        return k + 1, kept, softest, softest[0] @ softest[1]

    last = _INVERSE_ITERATIONS + 1 + _LOBPCG_STEPS
    goes_on = lambda carry: (carry[0] < _INVERSE_ITERATIONS) | ((carry[0] < last) & (carry[3] > 0))
    blank = jnp.zeros_like(start)
    kept = jnp.stack([jnp.stack([start, blank, start]), jnp.stack([blank] * 3)])
    start_of_loop = (jnp.zeros((), int), kept, jnp.stack([blank, blank]), jnp.zeros((), start.dtype))
    _, kept, softest, _ = jax.lax.while_loop(goes_on, improve, start_of_loop)
    return softest, kept[0, :2]


def _best_mixture(trial: Float[Array, "3 3 n"]) -> Float[Array, "2 3"]:
    """The weights of the lowest vector among three, and of the step that leads there from the first."""
    weights, axes = jnp.linalg.eigh(trial[:, 0] @ trial[:, 2].T)
    # A direction that is absent, or the same as the others, must not be the lowest.
    there = weights > _DEPENDENT
    axes = axes * jnp.where(there, jax.lax.rsqrt(jnp.where(there, weights, 1.0)), 0.0)
    curvatures = axes.T @ (trial[:, 0] @ trial[:, 1].T) @ axes
    curvatures = 0.5 * (curvatures + curvatures.T)
    curvatures = curvatures + jnp.diag(jnp.where(there, 0.0, 1 + 2 * jnp.linalg.norm(curvatures)))
    mixture = axes @ jnp.linalg.eigh(curvatures)[1][:, 0]
    mixture = jnp.where(mixture[0] < 0, -mixture, mixture)  # which has either sign
    return jnp.stack([mixture, mixture.at[0].set(0.0)])
