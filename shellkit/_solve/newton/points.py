"""Points that a minimiser comes to, and steps from one to the next, with what is known of them."""

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

    @classmethod
    def unevaluated(cls, y: Float[Array, " n"]) -> "Point":
        """A point of which nothing is known yet: zeros."""
        zero = jnp.zeros((), y.dtype)
        return cls(y, zero, jnp.zeros_like(y), zero)

    @property
    def finite(self) -> Bool[Array, ""]:
        """Whether energy and gradient are finite; a norm that overflows is not."""
        return jnp.isfinite(self.value) & jnp.isfinite(self.norm)


def choose(condition: Bool[Array, ""], first: Point, second: Point) -> Point:
    """The first point if the condition holds, else the second."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), first, second)


class Step(eqx.Module):
    """A step that is proposed. It is `regular`, or `escaping`, or `mixed`, or that of a shifted Hessian."""

    start: Point
    direction: Float[Array, " n"]
    size: Scalar
    """The largest entry of the direction."""
    slope: Scalar
    """Of the energy along the direction."""
    regular: Bool[Array, ""]
    """It is that of the Hessian itself, which is positive definite."""
    escaping: Bool[Array, ""]
    """It leads off a saddle."""
    mixed: Bool[Array, ""]
    """Strains are unknowns of their own; it may be regular as well."""


class Reached(eqx.Module):
    """Where a step has led, once it was searched along and corrected."""

    point: Point
    length: Scalar
    """The part of the direction that was taken, or, of a step that was made longer, tried last; zero if none was."""
    settled: Bool[Array, ""]
    """The last correction was within tolerance."""

    @property
    def stalled(self) -> Bool[Array, ""]:
        """Whether no part of the step was taken."""
        return self.length == 0
