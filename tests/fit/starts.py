"""What the tests of `fit_many` send to other processes, which must stand in a file that these can import."""

import equinox as eqx
import jax
import jax.numpy as jnp


class Well(eqx.Module):
    """A double well: minima at -1 and 1, of which the second is lower."""

    actuation: jax.Array

    def objective(self, start=None):
        x = self.actuation
        loss = jnp.sum((x**2 - 1) ** 2 + 0.1 * (1 - x))
        return loss, ({"Well": loss}, None)


def well(number):
    """A well to start from, at a random place; there is none of number 3."""
    if number == 3:
        raise RuntimeError("no start of number 3")
    return Well(jax.random.uniform(jax.random.key(number), (1,), float, -2, 2))
