"""Why a student who makes the teacher's shape does not find the teacher's pattern: what the shape of a nematic bilayer
tells of its directors, and what it cannot."""

import argparse
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import optax
from teacher import angle_between, shell

import shellkit as sk


mpl.use("Agg")
jax.config.update("jax_enable_x64", True)
sk.keep_compiled()

TOP, BOTTOM = "actuation.top.angle", "actuation.bottom.angle"
NOISE = 1e-3  # of a measured coordinate, in radii of the sphere
PRIOR = np.pi / np.sqrt(12)  # the standard deviation of an angle of which nothing is known
MISPRINT = np.deg2rad(2.0)  # of a fabricated angle


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=200, help="of the student's optimiser")
    parser.add_argument("--quick", action="store_true", help="a few steps and small pictures, to see that all runs")
    parser.add_argument("--out", type=Path, default=Path("out/identifiability"), help="folder for the results")
    options = parser.parse_args()

    mesh = sk.meshes.icosphere(subdivisions=1)
    up = sk.director_angles(mesh, jnp.array([0.0, 0.0, 1.0]))
    teacher = shell(mesh, up, up + jnp.pi / 2)
    angles = lambda p: (p.actuation.top.angle, p.actuation.bottom.angle)
    insight = sk.identifiability(teacher, where=angles)
    values = np.asarray(insight.singular_values)
    print(insight, end="\n\n")

    blank = jnp.zeros(mesh.n_faces)
    result = sk.fit(
        shell(mesh, blank, blank, loss=sk.VertexDistance(insight.equilibrium.vertices, aligner=sk.Kabsch())),
        optax.adam(0.1),
        steps=5 if options.quick else options.steps,
        where=angles,
    )
    student = angles(result.problem)
    miss = {
        TOP: np.asarray(angle_between(student[0], up)),
        BOTTOM: np.asarray(angle_between(student[1], up + jnp.pi / 2)),
    }
    rng = np.random.default_rng(0)
    sizes = np.concatenate([miss[TOP], miss[BOTTOM]])
    shuffled = rng.permutation(sizes) * rng.choice([-1, 1], sizes.size)
    random = {TOP: shuffled[:80], BOTTOM: shuffled[80:]}
    moved = lambda change: float(np.linalg.norm(insight.displacement(change)) / np.sqrt(mesh.n_vertices))
    share = np.asarray(insight.components(miss)) ** 2 / np.sum(sizes**2)
    print(f"The student misses the teacher's top pattern by {np.degrees(np.median(np.abs(miss[TOP]))):.1f}° (median).")
    never, faint = values < 1e-9 * values[0], values < 1e-1 * values[0]
    for which, words in ((never, "no shape can tell of"), (faint, "move the shape less than a tenth of the first")):
        part, chance = 100 * share[which].sum(), 100 * np.mean(which)
        print(f"{part:5.1f} % of that is in directions that {words}; by chance {chance:.0f} %.")
    off = sk.Kabsch()(result.problem().vertices, insight.equilibrium.vertices) - insight.equilibrium.vertices
    print(f"To first order it moves the shape by {moved(miss):.4f}; as large a miss at random, by {moved(random):.4f}.")
    print(f"In truth by {float(np.linalg.norm(off)) / np.sqrt(mesh.n_vertices):.4f}: the valley of patterns is curved.")

    spread = insight.posterior(NOISE, PRIOR)
    told = np.concatenate([spread[TOP], spread[BOTTOM]])
    known, vague = np.degrees(np.median(told)), 100 * np.mean(told > PRIOR / 2)
    print(f"Measured to {NOISE}, an angle is known to {known:.1f}° (median), of {np.degrees(PRIOR):.0f}° beforehand;")
    print(f"{vague:5.1f} % of the angles stay worse than half of that.")
    strays = insight.tolerance(MISPRINT)
    print(
        f"Angles printed to {np.degrees(MISPRINT):.0f}° make a shape true to {float(np.sqrt(np.mean(strays**2))):.4f}."
    )

    options.out.mkdir(parents=True, exist_ok=True)
    draw(insight, teacher, spread, options)
    print(f"The pictures are in {options.out}/")


def draw(insight, teacher, spread, options) -> None:
    """The singular values, and where the shape tells of the pattern."""
    import matplotlib.pyplot as plt

    values = np.asarray(insight.singular_values)
    figure, axis = plt.subplots(figsize=(6, 3.5), layout="constrained")
    seen = values > 1e-9 * values[0]
    axis.semilogy(np.flatnonzero(seen), values[seen], ".", color="#0072b2")
    axis.axvspan(float(np.count_nonzero(seen)), float(len(values)), color="#d55e00", alpha=0.15, lw=0)
    axis.text(
        0.5 * (np.count_nonzero(seen) + len(values)),
        values[0] / 3,
        "never\nseen",
        ha="center",
        va="top",
        color="#d55e00",
    )
    axis.set(xlabel="direction in the space of angles", ylabel="shape per radian", xlim=(0, len(values)))
    figure.savefig(options.out / "identifiability_spectrum.png", dpi=80 if options.quick else 160)
    size = (300, 320) if options.quick else (600, 640)
    degrees = [np.degrees(spread[name]) for name in (TOP, BOTTOM)]
    for name, field in zip(("top", "bottom"), degrees, strict=True):
        sk.plot(
            teacher,
            color=field,
            name=f"uncertainty, {name}",
            unit="°",
            color_range=(0.0, float(np.max(degrees))),
            size=size,
            save=options.out / f"identifiability_{name}.png",
        )


if __name__ == "__main__":
    main()
