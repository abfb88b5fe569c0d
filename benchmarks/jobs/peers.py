"""The ellipsoid by triangulax, put together as in its tutorial: from starting Python to the last step. Its relaxation
is part of the design step, so that the final shape comes with that."""

import sys
from functools import partial

import equinox as eqx
import jax
import optax

from .. import peer
from ..tutorial import fields
from . import mark


_MAX_STEPS = 4000  # of the relaxation, as for the design step


def main(path: str, steps: int, adjoint: str) -> None:
    jax.config.update("jax_enable_x64", True)
    mark("imported")
    scene = peer.Scene.read(path, "ellipsoid", 1.1, _MAX_STEPS, peer.TOLERANCE)
    angles = fields("zero", scene.mesh.n_faces)
    jax.block_until_ready(angles)
    mark("problem built")
    optimiser = optax.adam(0.1)
    state = optimiser.init(angles)

    @eqx.filter_jit
    def step(scene, angles, state):
        (value, _), gradient = partial(peer.design_step, adjoint)(scene, angles)
        updates, state = optimiser.update(gradient, state)
        return optax.apply_updates(angles, updates), state, value

    for number in range(steps):
        angles, state, _ = jax.block_until_ready(step(scene, angles, state))
        if number == 0:
            mark("first design step")
    mark("all steps")
    mark("final shape")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), sys.argv[3])
