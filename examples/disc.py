"""A flat disc of two nematic layers that is trained to become a spherical cap, and another a saddle: one opens its rim
and the other has too much of it."""

import argparse
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optax

import shellkit as sk


jax.config.update("jax_enable_x64", True)
sk.keep_compiled()

THICKNESS, STRETCH, CURVATURE = 0.05, 1.1, 0.5


def cap(vertices: jax.Array) -> jax.Array:
    """The disc laid on a sphere, its radii as long as before."""
    r = jnp.linalg.norm(vertices[:, :2], axis=1, keepdims=True)
    outwards = vertices[:, :2] / jnp.where(r > 0, r, 1.0)
    angle = CURVATURE * r
    return jnp.concatenate([jnp.sin(angle) * outwards, 1 - jnp.cos(angle)], axis=1) / CURVATURE


def saddle(vertices: jax.Array) -> jax.Array:
    """The disc bent one way along x and the other way along y."""
    x, y, _ = vertices.T
    return jnp.stack([x, y, CURVATURE / 2 * (x**2 - y**2)], axis=1)


def design(mesh: sk.Mesh, target: jax.Array) -> sk.InverseProblem:
    """The disc with the directors nearest to the layers that would make the target exactly."""
    return sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        actuation=sk.nematic_start(mesh, target, THICKNESS, stretch=STRETCH),
        energy=sk.StVenantKirchhoff.from_young(1.0, 0.3) + sk.Bending.from_young(1.0, 0.3),
        loss=sk.VertexDistance(target, aligner=sk.Kabsch()) + 1e-4 * sk.DirectorSmoothness(),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--edge", type=float, default=0.12, help="length of the edges of the mesh")
    parser.add_argument("--steps", type=int, default=60, help="of Adam; a quarter as many of Levenberg follow")
    parser.add_argument("--quick", action="store_true", help="a few steps and small pictures, to see that all runs")
    parser.add_argument("--out", type=Path, default=Path("out/disc"), help="folder for the results")
    options = parser.parse_args()
    if options.quick:
        options.edge, options.steps = 0.25, 3

    mesh = sk.meshes.disc(radius=1.0, target_edge_length=options.edge)
    options.out.mkdir(parents=True, exist_ok=True)
    for name, shape in (("cap", cap), ("saddle", saddle)):
        target = shape(mesh.vertices)
        wants = sk.feasibility(mesh, target, THICKNESS)
        problem = design(mesh, target)
        angles = lambda p: (p.actuation.top.angle, p.actuation.bottom.angle)
        # Adam gets past the snaps on the way; the other goes straight to the bottom from there.
        rough = sk.fit(problem, optax.adam(0.03), steps=options.steps, where=angles)
        squares = sk.LevenbergMarquardt(rtol=1e-6, atol=1e-9)
        result = sk.fit(rough.problem, squares, steps=max(options.steps // 4, 1), where=angles)
        distance = lambda p: float(np.sqrt(p.evaluate()[1]["VertexDistance"]))
        start, end = distance(problem), distance(result.problem)
        depth = float(jnp.ptp(target[:, 2]))
        print(f"{name}: an exact sheet would stretch by up to {float(jnp.max(wants.top)):.3f}; ours does by {STRETCH}.")
        middle = distance(rough.problem)
        print(f"  root mean square distance {start:.4f} -> {middle:.4f} -> {end:.4f}, of a depth of {depth:.2f}")
        sk.plot(
            result,
            size=(240, 240) if options.quick else (480, 420),
            save=options.out / f"disc_{name}.png",
        )
    print(f"The pictures are in {options.out}/")


if __name__ == "__main__":
    main()
