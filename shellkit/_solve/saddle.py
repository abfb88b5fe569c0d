"""The way off a saddle."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Scalar


_INVERSE_ITERATIONS = 8


def away_from_saddle(
    solve: Callable[[Array], Array], gradient: Float[Array, " n"], length: Scalar
) -> Float[Array, " n"]:
    """A step along the softest direction of the convex model, not uphill, by inverse iteration with its factor.

    Not along the lowest direction of the Hessian itself: what is most unstable while a shell has still to grow is
    often stable where it grows to, and leads into crumpled states.

    **Arguments:**

    - `solve`: with the matrix that was made convex and factorised.
    - `gradient`: where the step begins.
    - `length`: the largest entry of the step.
    """
    vector = jax.random.normal(jax.random.key(0), gradient.shape, gradient.dtype)
    refine = lambda _, v: (lambda w: w / jnp.max(jnp.abs(w)))(solve(v))
    vector = length * jax.lax.fori_loop(0, _INVERSE_ITERATIONS, refine, vector)
    return jnp.where(gradient @ vector > 0, -vector, vector)
