"""The ellipsoid by shellkit: from starting Python to the final shape."""

import sys

import jax
import jax.numpy as jnp
import optax

import shellkit as sk

from . import mark


def main(path: str, steps: int) -> None:
    jax.config.update("jax_enable_x64", True)
    mark("imported")
    mesh = sk.Mesh.read(path)
    target = mesh.vertices * jnp.array([0.95, 0.95, 1.2])
    angles = jnp.zeros(mesh.n_faces)
    jax.block_until_ready(target)
    mark("mesh read")
    problem = sk.InverseProblem(
        mesh=mesh,
        thickness=0.1,
        actuation=sk.Bilayer(top=sk.Nematic(angles, stretch=1.1), bottom=sk.Nematic(angles, stretch=1.1)),
        energy=sk.StVenantKirchhoff(alpha=1.0, beta=1.0) + sk.Bending(alpha=1.0, beta=1.0),
        loss=sk.VertexDistance(target, aligner=sk.Kabsch()) + 1e-3 * sk.DirectorSmoothness(),
    )
    mark("problem built")

    def first(step: sk.FitStep) -> None:
        if step.step == 0:
            mark("first design step")

    result = sk.fit(
        problem,
        optax.adam(0.1),
        steps=steps,
        where=lambda p: (p.actuation.top.angle, p.actuation.bottom.angle),
        progress=False,
        callbacks=[first],
    )
    mark("all steps")
    jax.block_until_ready(result.problem().vertices)
    mark("final shape")
    print(float(result.history["VertexDistance"][-1]))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
