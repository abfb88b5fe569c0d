"""Points that a minimiser comes to, with what it knows of them."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Scalar


class Point(eqx.Module):
    """A point with its energy, its gradient, and the norm of that."""

    y: Float[Array, " n"]
    value: Scalar
    gradient: Float[Array, " n"]
    norm: Scalar

    @classmethod
    def of(cls, y: Float[Array, " n"], value: Scalar, gradient: Float[Array, " n"]) -> "Point":
        """A point, with its norm."""
        return cls(y, value, gradient, jnp.linalg.norm(gradient))

    @property
    def finite(self) -> Bool[Array, ""]:
        """Whether energy and gradient are finite; a norm that overflows is not."""
        return jnp.isfinite(self.value) & jnp.isfinite(self.norm)


def choose(condition: Bool[Array, ""], first: Point, second: Point) -> Point:
    """The first point if the condition holds, else the second."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), first, second)
