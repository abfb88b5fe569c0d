"""A sphere that becomes an ellipsoid: two layers of nematic directors are designed so that the heated shell takes on a
given shape. The second design of the triangulax tutorial on inverse problems, at its own settings."""

import argparse
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optax

import shellkit as sk


jax.config.update("jax_enable_x64", True)
sk.keep_compiled()

# What the tutorial prints for so many vertices and steps.
TUTORIAL = {
    (42, 200): ("6.18e-03", "5.66e-04", "0.054", "a few ms"),
    (642, 100): ("5.94e-03", "5.31e-04", "0.052", "about 1 s"),
}


def ellipsoid_problem(mesh: sk.Mesh) -> sk.InverseProblem:
    """The shell with all directors along the first edge of their face, and the ellipsoid that it should become."""
    layer = sk.Nematic(angle=jnp.zeros(mesh.n_faces), stretch=1.1)
    return sk.InverseProblem(
        mesh=mesh,
        thickness=0.1,
        actuation=sk.Bilayer(top=layer, bottom=layer),
        energy=sk.StVenantKirchhoff(alpha=1.0, beta=1.0) + sk.Bending(alpha=1.0, beta=1.0),
        loss=sk.VertexDistance(mesh.vertices * jnp.array([0.95, 0.95, 1.2]), aligner=sk.Kabsch())
        + 1e-3 * sk.DirectorSmoothness(),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--subdivisions", type=int, default=1, help="of the icosahedron: 1 gives 42 vertices, 3 gives 642"
    )
    parser.add_argument("--steps", type=int, help="of the optimiser (default: 200, or 100 for fine meshes)")
    parser.add_argument("--quick", action="store_true", help="a few steps and small pictures, to see that all runs")
    parser.add_argument("--out", type=Path, default=Path("out/ellipsoid"), help="folder for the results")
    options = parser.parse_args()

    mesh = sk.meshes.icosphere(subdivisions=options.subdivisions)
    steps = 5 if options.quick else options.steps or (200 if mesh.n_vertices < 300 else 100)
    result = sk.fit(
        ellipsoid_problem(mesh),
        optax.adam(0.1),
        steps=steps,
        where=lambda p: (p.actuation.top.angle, p.actuation.bottom.angle),
    )

    design = result.problem
    target = design.loss.terms[0].target
    shape = sk.Kabsch()(design().vertices, target)
    fit = result.history["VertexDistance"]
    tutorial = TUTORIAL.get((mesh.n_vertices, steps), ("-", "-", "-", "-"))
    ours = (
        f"{fit[0]:.2e}",
        f"{jnp.mean((shape - target) ** 2):.2e}",
        f"{jnp.linalg.norm(shape - target, axis=1).max():.3f}",
        f"{1e3 * np.median(np.diff(result.history['seconds'])):.0f} ms",
    )
    # All angles zero is another pattern for other first edges of the faces: the starts need not agree.
    names = ("fit at the start", "fit of the design", "largest vertex error", "time a design step")
    print(f"Ellipsoid, {mesh.n_vertices} vertices, {steps} steps of Adam")
    print(f"{'':<24}{'tutorial':>12}{'shellkit':>12}")
    for name, theirs, found in zip(names, tutorial, ours, strict=True):
        print(f"{name:<24}{theirs:>12}{found:>12}")

    options.out.mkdir(parents=True, exist_ok=True)
    mesh.write(
        options.out / "ellipsoid.vtu",
        vertex_data={"relaxed": shape, "target": target},
        face_data={"top_angle": design.actuation.top.angle, "bottom_angle": design.actuation.bottom.angle},
    )
    sk.plot_history(result, save=options.out / "ellipsoid_history.png")
    sk.plot(
        result,
        title=["at rest, with its directors", "relaxed", "target"],
        size=(300, 320) if options.quick else (600, 640),
        save=options.out / "ellipsoid.png",
    )
    print(f"The design (vtu) and its pictures are in {options.out}/")


if __name__ == "__main__":
    main()
