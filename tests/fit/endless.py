"""A fit that writes its checkpoint at every step and does not end: the program that `test_checkpoint.py` kills."""

import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import optax


jax.config.update("jax_enable_x64", True)

from shellkit._fit.checkpoint import Checkpoint  # noqa: E402
from shellkit._fit.fit import fit  # noqa: E402


class Bowl(eqx.Module):
    depth: jax.Array

    def objective(self, start=None):
        loss = jnp.sum(self.depth**2)
        return loss, ({"Depth": loss}, None)


def run(path, steps):
    # Large enough that writing takes most of the time.
    problem = Bowl(jnp.linspace(1.0, 2.0, 20_000))
    return fit(problem, optax.adam(0.01), steps=steps, where=lambda p: p.depth, checkpoint=Checkpoint(path, every=1))


if __name__ == "__main__":
    run(sys.argv[1], 10**9)
