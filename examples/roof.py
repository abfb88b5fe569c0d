"""A shallow hinged roof that is pressed down at its middle until it snaps through: the whole path, through both limit
loads, where a load that only rises would jump."""

import argparse
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np

import shellkit as sk


mpl.use("Agg")
jax.config.update("jax_enable_x64", True)
sk.keep_compiled()

RADIUS, LENGTH, HALF_ANGLE, YOUNG, POISSON, FORCE = 2540.0, 508.0, 0.1, 3102.75, 0.3, 3000.0
# Sze, Liu and Lo (2004), for the thickness 12.7 mm: the limit load over 3000 N, and the deflection there in mm.
KNOWN = (0.7421, 11.29)


def roof(cells: int, thickness: float) -> tuple[sk.InverseProblem, int]:
    """A part of a cylinder, its straight edges hinged and the curved ones free; and the vertex at its middle."""
    flat = sk.meshes.rectangle(length=1.0, width=LENGTH, cells=(cells, cells))
    x, y, _ = flat.vertices.T
    angle = HALF_ANGLE * (2 * x - 1)
    bent = jnp.stack([RADIUS * jnp.sin(angle), y, RADIUS * (jnp.cos(angle) - np.cos(HALF_ANGLE))], axis=1)
    mesh = flat.with_vertices(bent)
    middle = int(np.argmin(np.abs(np.asarray(x) - 0.5) + np.abs(np.asarray(y) / LENGTH - 0.5)))
    problem = sk.InverseProblem(
        mesh=mesh,
        thickness=thickness,
        energy=sk.StVenantKirchhoff.from_young(YOUNG, POISSON)
        + sk.Bending.from_young(YOUNG, POISSON, directors="free")
        + sk.PointLoad([middle], [0.0, 0.0, -FORCE]),
        supports=sk.Pinned(jnp.isclose(x, 0.0) | jnp.isclose(x, 1.0)),
    )
    return problem, middle


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, default=16, help="along each side")
    parser.add_argument("--thickness", type=float, default=12.7, help="12.7 snaps through; 6.35 snaps back as well")
    parser.add_argument("--quick", action="store_true", help="a coarse mesh and small pictures, to see that all runs")
    parser.add_argument("--out", type=Path, default=Path("out/roof"), help="folder for the results")
    options = parser.parse_args()

    problem, middle = roof(4 if options.quick else options.cells, options.thickness)
    branch = sk.continue_path(problem, path=sk.ArcLength(first=0.1, steps=8 if options.quick else 60))
    load = np.asarray(branch.progress)
    down = np.array([float(problem.mesh.vertices[middle, 2] - e.vertices[middle, 2]) for e in branch.equilibria])
    print(branch)
    for point in branch.critical:
        way = float(problem.mesh.vertices[middle, 2] - point.equilibrium.vertices[middle, 2])
        print(f"{point.kind}: {point.progress:.4f} of {FORCE:.0f} N, {way:.2f} mm down", end="")
        print(f"; known {KNOWN[0]} at {KNOWN[1]} mm" if options.thickness == 12.7 and way < 15 else "")

    options.out.mkdir(parents=True, exist_ok=True)
    draw(down, load, np.asarray(branch.negative), options)
    print(f"The picture is in {options.out}/")


def draw(down: np.ndarray, load: np.ndarray, negative: np.ndarray, options: argparse.Namespace) -> None:
    """The load against the way of the middle, stable parts filled."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3.5), layout="constrained")
    axis.plot(down, FORCE * load, color="0.7", lw=1)
    for stable, name, colour in ((True, "stable", "#0072b2"), (False, "not stable", "#d55e00")):
        shown = (negative == 0) == stable
        axis.plot(down[shown], FORCE * load[shown], "o", ms=4, color=colour, label=name)
    axis.set(xlabel="way of the middle in mm", ylabel="force in N")
    axis.legend(frameon=False)
    figure.savefig(options.out / "roof.png", dpi=80 if options.quick else 160)


if __name__ == "__main__":
    main()
