"""Vector algebra on arrays whose last axis runs over elements and whose last but one over x, y and z.

XLA on a CPU vectorises such index-last arrays far better than `(F, 3)` ones; the sums over components are written out
because a reduction over a small axis is an order slower.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int


def dot(a: Float[Array, "*#m 3 n"], b: Float[Array, "*#m 3 n"]) -> Float[Array, "*#m n"]:
    """Scalar product over the component axis."""
    return a[..., 0, :] * b[..., 0, :] + a[..., 1, :] * b[..., 1, :] + a[..., 2, :] * b[..., 2, :]


def cross(a: Float[Array, "*#m 3 n"], b: Float[Array, "*#m 3 n"]) -> Float[Array, "*#m 3 n"]:
    """Vector product over the component axis."""
    ax, ay, az = a[..., 0, :], a[..., 1, :], a[..., 2, :]
    bx, by, bz = b[..., 0, :], b[..., 1, :], b[..., 2, :]
    return jnp.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-2)


def gather(points: Float[Array, "V 3"], index: Int[Array, "n k"]) -> Float[Array, "k 3 n"]:
    """The points of every element, index-last."""
    components = points.T
    return jnp.stack([components[:, index[:, i]] for i in range(index.shape[1])])
