"""Problems whose designs, losses and gradients are known on paper, with the one method that `fit` asks for."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest


class Sheet(eqx.Module):
    angle: jax.Array
    stretch: jax.Array


class Shape(eqx.Module):
    """As much of an equilibrium as a fit looks at."""

    vertices: jax.Array
    directors: Any
    gradient_norm: jax.Array
    steps: jax.Array
    converged: jax.Array
    stable: jax.Array
    result: str = eqx.field(static=True, default="stand-in")


class Quadratic(eqx.Module):
    """The shape is the angle itself; the loss is the weighted squared distance to a target, and a hundredth of the
    squared angle: its minimum is at target · weight / (weight + 0.01). No relaxation converges where any angle is above
    `limit`, and the loss is NaN above `cliff`."""

    actuation: Sheet
    target: jax.Array
    weight: jax.Array
    limit: jax.Array
    cliff: jax.Array
    count: jax.Array
    kind: str = eqx.field(static=True, default="plain")
    traced: Callable[[], None] = eqx.field(static=True, default=lambda: None)

    def objective(self, start=None):
        self.traced()
        angle = self.actuation.angle * self.actuation.stretch
        distance, size = jnp.sum(self.weight * (angle - self.target) ** 2), jnp.sum(angle**2)
        loss = distance + 0.01 * size
        loss = jnp.where(jnp.any(angle > self.cliff), jnp.nan, loss)
        shape = Shape(
            vertices=angle,
            directors=None,
            gradient_norm=jnp.asarray(1e-12),
            steps=jnp.asarray(7 if start is None else 3),
            converged=jnp.all(angle <= self.limit),
            stable=jnp.asarray(True),
        )
        return loss, ({"Distance": distance, "Size": size}, shape)


class Wells(eqx.Module):
    """A point each in the double well ¼(v² − 1)² − load · v, relaxed downhill from v = 1 or from the start it is given:
    of two equilibria it takes the one whose basin it starts in. The loss is the squared distance to a target."""

    actuation: Sheet
    target: jax.Array

    def objective(self, start=None):
        load = self.actuation.angle
        force = lambda v: v**3 - v - load
        flow = lambda v, _: (v - 0.2 * force(v), None)
        v = jnp.ones_like(load) if start is None else start.vertices
        v, _ = jax.lax.scan(flow, jax.lax.stop_gradient(v), None, length=400)
        v = jax.lax.stop_gradient(v)
        v = v - force(v) / (3 * v**2 - 1)  # its derivative in the load is the implicit one
        left = jnp.linalg.norm(jax.lax.stop_gradient(force(v)))
        shape = Shape(v, None, left, jnp.asarray(400), left < 1e-8, jnp.asarray(True))
        loss = jnp.sum((v - self.target) ** 2)
        return loss, ({"Distance": loss}, shape)


def quadratic(n: int = 3, start: float = 0.0, **parts) -> Quadratic:
    given = {
        "target": jnp.arange(1.0, n + 1),
        "weight": jnp.ones(n),
        "limit": jnp.asarray(jnp.inf),
        "cliff": jnp.asarray(jnp.inf),
        "count": jnp.asarray(2),
    }
    return Quadratic(Sheet(jnp.full(n, start), jnp.ones(())), **(given | parts))


def wells(load: float, target: float) -> Wells:
    return Wells(Sheet(jnp.full(1, load), jnp.ones(())), jnp.full(1, target))


@pytest.fixture
def make_quadratic():
    return quadratic


@pytest.fixture
def make_wells():
    return wells


@pytest.fixture
def angle():
    return lambda problem: problem.actuation.angle
