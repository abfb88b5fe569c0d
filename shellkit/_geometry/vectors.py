"""Vector algebra on arrays whose last axis runs over elements and whose last but one over x, y and z.

XLA on a CPU vectorises such index-last arrays far better than `(F, 3)` ones; the sums over components are written out
because a reduction over a small axis is an order slower.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int


def dot(a: Float[Array, "*#m 3 n"], b: Float[Array, "*#m 3 n"]) -> Float[Array, "*#m n"]:
    """Scalar product over the component axis."""
    product = a * b
    return product[..., 0, :] + product[..., 1, :] + product[..., 2, :]


def cross(a: Float[Array, "*#m 3 n"], b: Float[Array, "*#m 3 n"]) -> Float[Array, "*#m 3 n"]:
    """Vector product over the component axis."""
    ax, ay, az = a[..., 0, :], a[..., 1, :], a[..., 2, :]
    bx, by, bz = b[..., 0, :], b[..., 1, :], b[..., 2, :]
    return jnp.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-2)


def gather(points: Float[Array, "V 3"], index: Int[Array, "n k"]) -> Float[Array, "k 3 n"]:
    """The points of every element, index-last. Indices must be those of points: none is looked at."""
    flat = points.T.at[:, index.T.reshape(-1)].get(mode="promise_in_bounds", wrap_negative_indices=False)
    return jnp.moveaxis(flat.reshape(3, index.shape[1], index.shape[0]), 1, 0)
