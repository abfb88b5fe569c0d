"""A network of sines writes the directors of a sphere that becomes an ellipsoid: trained on a coarse mesh, its weights
go on on finer ones as they are."""

import argparse
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax

import shellkit as sk


jax.config.update("jax_enable_x64", True)
sk.keep_compiled()

FIELDS = lambda problem: (problem.actuation.top.field, problem.actuation.bottom.field)


def ellipsoid(mesh: sk.Mesh, fields: tuple[eqx.nn.MLP, eqx.nn.MLP]) -> sk.InverseProblem:
    """The shell with a field of directors in each layer, and the ellipsoid that it should become."""
    top, bottom = (sk.NeuralDirectors(field, stretch=1.1) for field in fields)
    return sk.InverseProblem(
        mesh=mesh,
        thickness=0.1,
        actuation=sk.Bilayer(top=top, bottom=bottom),
        energy=sk.StVenantKirchhoff(alpha=1.0, beta=1.0) + sk.Bending(alpha=1.0, beta=1.0),
        loss=sk.VertexDistance(mesh.vertices * jnp.array([0.95, 0.95, 1.2]), aligner=sk.Kabsch()),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=100, help="of the optimiser, on the coarsest mesh")
    parser.add_argument("--quick", action="store_true", help="a few steps on coarse meshes, to see that all runs")
    parser.add_argument("--out", type=Path, default=Path("out/neural_field"), help="folder for the results")
    options = parser.parse_args()

    keys = jax.random.split(jax.random.key(0), 2)
    network = lambda key: eqx.nn.MLP(3, 6, width_size=32, depth=2, activation=jnp.sin, key=key)
    fields = network(keys[0]), network(keys[1])
    weights = sum(leaf.size for leaf in jax.tree.leaves(eqx.filter(fields, eqx.is_array)))
    print(f"Two networks with {weights} weights in all")
    print(f"{'vertices':>8}{'steps':>8}{'as it came':>14}{'trained':>12}{'time a step':>14}")
    result = None
    for subdivisions, steps in ((1, 5),) if options.quick else ((1, options.steps), (3, 20), (4, 5)):
        mesh = sk.meshes.icosphere(subdivisions=subdivisions)
        result = sk.fit(ellipsoid(mesh, fields), optax.adam(3e-3), steps=steps, where=FIELDS)
        fields = FIELDS(result.problem)
        loss = result.history["VertexDistance"]
        duration = 1e3 * np.median(np.diff(result.history["seconds"]))
        print(f"{mesh.n_vertices:>8}{steps:>8}{loss[0]:>14.2e}{result.best_loss:>12.2e}{duration:>11.0f} ms")

    assert result is not None
    options.out.mkdir(parents=True, exist_ok=True)
    sk.plot(
        result,
        title=["at rest, with its directors", "relaxed", "target"],
        size=(300, 320) if options.quick else (600, 640),
        save=options.out / "neural_field.png",
    )
    print(f"The picture is in {options.out}/")


if __name__ == "__main__":
    main()
