"""A hidden pattern recovered from the shape that it makes: a teacher shell with crossed directors buckles, and a
student learns to take on the same shape. The first design of the triangulax tutorial on inverse problems, at its own
settings."""

import argparse
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optax

import shellkit as sk


jax.config.update("jax_enable_x64", True)
sk.keep_compiled()

# What the tutorial prints for 42 vertices after 200 steps; it does not do this design on a finer mesh.
TUTORIAL = ("0.393", "0.0031", "25.6°", "a few ms")


def shell(mesh: sk.Mesh, top: jax.Array, bottom: jax.Array, loss: sk.Loss | None = None) -> sk.InverseProblem:
    """A sphere of two layers, with a director in each face of each."""
    return sk.InverseProblem(
        mesh=mesh,
        thickness=0.1,
        actuation=sk.Bilayer(top=sk.Nematic(angle=top, stretch=1.1), bottom=sk.Nematic(angle=bottom, stretch=1.1)),
        energy=sk.StVenantKirchhoff(alpha=1.0, beta=1.0) + sk.Bending(alpha=1.0, beta=1.0),
        loss=loss,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--subdivisions", type=int, default=1, help="of the icosahedron: 1 gives 42 vertices, 3 gives 642"
    )
    parser.add_argument("--steps", type=int, help="of the optimiser (default: 200, or 100 for fine meshes)")
    parser.add_argument("--quick", action="store_true", help="a few steps and small pictures, to see that all runs")
    parser.add_argument("--out", type=Path, default=Path("out/teacher"), help="folder for the results")
    options = parser.parse_args()
    mesh = sk.meshes.icosphere(subdivisions=options.subdivisions)
    steps = 5 if options.quick else options.steps or (200 if mesh.n_vertices < 300 else 100)

    up = sk.director_angles(mesh, jnp.array([0.0, 0.0, 1.0]))  # the z axis projected on each face
    teacher = shell(mesh, up, up + jnp.pi / 2)
    target = teacher().vertices

    blank = jnp.zeros(mesh.n_faces)
    result = sk.fit(
        shell(mesh, blank, blank, loss=sk.VertexDistance(target, aligner=sk.Kabsch())),
        optax.adam(0.1),
        steps=steps,
        where=lambda p: (p.actuation.top.angle, p.actuation.bottom.angle),
    )
    top, bottom = result.problem.actuation.top.angle, result.problem.actuation.bottom.angle
    shape = sk.Kabsch()(result.problem().vertices, target)

    ours = (
        f"{jnp.linalg.norm(target - mesh.vertices, axis=1).max():.3f}",
        f"{jnp.linalg.norm(shape - target, axis=1).max():.4f}",
        f"{np.degrees(np.median(np.abs(angle_between(top, up)))):.1f}°",
        f"{1e3 * np.median(np.diff(result.history['seconds'])):.0f} ms",
    )
    names = (
        "displacement of the teacher",
        "largest vertex error",
        "median director error, top",
        "time a design step",
    )
    tutorial = (
        TUTORIAL if (mesh.n_vertices, steps) == (42, 200) else (TUTORIAL[0] if mesh.n_vertices == 42 else "-", *"---")
    )
    print(f"Teacher and student, {mesh.n_vertices} vertices, {steps} steps of Adam")
    print(f"{'':<28}{'tutorial':>12}{'shellkit':>12}")
    for name, theirs, found in zip(names, tutorial, ours, strict=True):
        print(f"{name:<28}{theirs:>12}{found:>12}")

    options.out.mkdir(parents=True, exist_ok=True)
    mesh.write(
        options.out / "teacher.vtu",
        vertex_data={"relaxed": shape, "target": target},
        face_data={
            "top_angle": top,
            "bottom_angle": bottom,
            "teacher_top_angle": up,
            "teacher_bottom_angle": up + jnp.pi / 2,
        },
    )
    sk.plot_history(result, save=options.out / "teacher_history.png")
    sk.plot(
        result,
        target=teacher,
        title=["student at rest", "student relaxed", "teacher relaxed"],
        size=(300, 320) if options.quick else (600, 640),
        save=options.out / "teacher.png",
    )
    print(f"The design (vtu) and its pictures are in {options.out}/")


def angle_between(angle: jax.Array, other: jax.Array) -> jax.Array:
    """Between two directors, which have no heads: in [-π/2, π/2)."""
    return (angle - other + jnp.pi / 2) % jnp.pi - jnp.pi / 2


if __name__ == "__main__":
    main()
