"""Stretches along directions in a face, as metrics in the basis of its edges."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._geometry.forms import components, determinant, matrices


def stretched_metric(
    metric: Float[Array, "F 2 2"],
    angle: Float[Array, " F"],
    along: Float[Array, ""] | Float[Array, " F"],
    across: Float[Array, ""] | Float[Array, " F"],
) -> Float[Array, "F 2 2"]:
    """B^T S B, with B^T B the metric, B upper triangular, and S the squared stretches along and across a direction.

    The direction is at `angle` from the first edge u = b - a of the face (a, b, c), turning towards c.
    """
    g11, g12, g22 = components(metric)
    root = jnp.sqrt(g11)
    height = jnp.sqrt(determinant((g11, g12, g22))) / root
    mean = 0.5 * (along**2 + across**2)
    difference = 0.5 * (along**2 - across**2)
    s11, s12, s22 = (
        mean + difference * jnp.cos(2 * angle),
        difference * jnp.sin(2 * angle),
        mean - difference * jnp.cos(2 * angle),
    )
    # The columns of B are u = (root, 0) and v = (g12 / root, height).
    shift = g12 / root
    along_v = s11 * shift + s12 * height
    return matrices((s11 * g11, root * along_v, shift * along_v + height * (s12 * shift + s22 * height)))
