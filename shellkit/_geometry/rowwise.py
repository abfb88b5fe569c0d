"""Products, lengths and angles of vectors in space, one vector a row. Where a length or an area vanishes, what has no
value there is given as zero with derivative zero, so that degenerate elements give finite gradients; what is not a
number stays so."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def dot(a: Float[Array, "*n 3"], b: Float[Array, "*n 3"]) -> Float[Array, "*n"]:
    """Inner product of each pair of rows."""
    return jnp.sum(a * b, axis=-1)


def length(a: Float[Array, "*n 3"]) -> Float[Array, "*n"]:
    """Euclidean length of each row; at a zero row, value and derivative are zero."""
    return root(dot(a, a))


def unit(a: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
    """Each row divided by its length; a zero row stays zero."""
    return over(a, length(a)[..., None])


def root(x: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Square root; where `x` is not positive, value and derivative are zero."""
    absent = x <= 0
    return jnp.where(absent, 0.0, jnp.sqrt(jnp.where(absent, 1.0, x)))


def over(a: Float[Array, "..."], b: Float[Array, "..."]) -> Float[Array, "..."]:
    """Quotient; where the divisor is zero, value and derivative are zero."""
    absent = b == 0
    return jnp.where(absent, 0.0, a / jnp.where(absent, 1.0, b))


def angle(sine: Float[Array, "*n"], cosine: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """`arctan2`, with value and derivative zero where both arguments vanish."""
    defined = (sine != 0) | (cosine != 0)
    return jnp.arctan2(jnp.where(defined, sine, 0.0), jnp.where(defined, cosine, 1.0))
