"""One sphere in two states: two layers of directors are designed so that the shell is a little longer when it is warm,
and shorter and wider when it is cooled below the temperature at which it was made."""

import argparse
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optax

import shellkit as sk


jax.config.update("jax_enable_x64", True)
sk.keep_compiled()

LAYERS = lambda problem: (problem.actuation.top.angle, problem.actuation.bottom.angle)


def shell(mesh: sk.Mesh, stretch: float, target: jax.Array) -> sk.InverseProblem:
    """The sphere at one temperature, with all directors towards the poles, and what it should become there."""
    to_poles = sk.director_angles(mesh, jnp.array([0.0, 0.0, 1.0]))
    layer = sk.Nematic(angle=to_poles, stretch=stretch)
    return sk.InverseProblem(
        mesh=mesh,
        thickness=0.1,
        actuation=sk.Bilayer(top=layer, bottom=layer),
        energy=sk.StVenantKirchhoff(alpha=1.0, beta=1.0) + sk.Bending(alpha=1.0, beta=1.0),
        loss=sk.VertexDistance(target, aligner=sk.Kabsch()),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--subdivisions", type=int, default=2, help="of the icosahedron: 2 gives 162 vertices")
    parser.add_argument("--steps", type=int, default=100, help="of the optimiser")
    parser.add_argument("--quick", action="store_true", help="a few steps and small pictures, to see that all runs")
    parser.add_argument("--out", type=Path, default=Path("out/states"), help="folder for the results")
    options = parser.parse_args()

    mesh = sk.meshes.icosphere(subdivisions=1 if options.quick else options.subdivisions)
    targets = {
        "warm": mesh.vertices * jnp.array([0.97, 0.97, 1.07]),
        "cooled": mesh.vertices * jnp.array([1.03, 1.03, 0.93]),
    }
    stretches = {"warm": 1.07, "cooled": 1 / 1.07}
    states = sk.States({name: shell(mesh, stretches[name], targets[name]) for name in targets}, shared=LAYERS)
    steps = 5 if options.quick else options.steps
    result = sk.fit(states, optax.adam(0.02), steps=steps, where=LAYERS)

    print(f"A sphere in two states, {mesh.n_vertices} vertices, {steps} steps of Adam")
    print(f"{'':<10}{'at the start':>14}{'of the design':>16}{'largest error':>16}")
    found = result.problem()
    for name, equilibrium in found.items():
        target = targets[name]
        shape = sk.Kabsch()(equilibrium.vertices, target)
        first = float(result.history[f"{name}.VertexDistance"][0])
        last = float(jnp.mean((shape - target) ** 2))
        worst = float(jnp.max(jnp.linalg.norm(shape - target, axis=1)))
        print(f"{name:<10}{first:>14.2e}{last:>16.2e}{worst:>16.4f}")
    print(f"a design step: {1e3 * np.median(np.diff(result.history['seconds'])):.0f} ms")

    options.out.mkdir(parents=True, exist_ok=True)
    size = (300, 320) if options.quick else (600, 640)
    sk.plot_history(result, save=options.out / "states_history.png")
    sk.plot(result, color="error", size=size, save=options.out / "states.png")
    print(f"The pictures are in {options.out}/")


if __name__ == "__main__":
    main()
