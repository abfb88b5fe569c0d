"""A flat strip of two layers that rolls up into a closed ring: the layers differ in length by just as much as it takes
(Timoshenko's bimetal)."""

import argparse
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import shellkit as sk


jax.config.update("jax_enable_x64", True)
sk.keep_compiled()

LENGTH, WIDTH, THICKNESS, POISSON = 1.0, 0.3, 0.01, 0.3
MISFIT = 2 * THICKNESS / 3 * 2 * np.pi / LENGTH  # κ = 3 Δε / 2h, for one full turn


def strip(cells: int, growth: sk.Actuation | None) -> sk.InverseProblem:
    """The strip along x, free of supports."""
    return sk.InverseProblem(
        mesh=sk.meshes.rectangle(length=LENGTH, width=WIDTH, cells=(cells, max(2, round(WIDTH * cells)))),
        thickness=THICKNESS,
        actuation=growth,
        energy=sk.StVenantKirchhoff.from_young(1.0, POISSON) + sk.Bending.from_young(1.0, POISSON, directors="free"),
    )


def two_layers(mesh: sk.Mesh) -> sk.Bilayer:
    """The upper layer grows along the strip by half the misfit, the lower one shrinks by as much."""
    along = sk.director_angles(mesh, jnp.array([1.0, 0.0, 0.0]))
    layer = lambda sign: sk.OrthotropicGrowth(along, along=1 + sign * MISFIT / 2, across=1.0)
    return sk.Bilayer(top=layer(1.0), bottom=layer(-1.0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, default=40, help="along the strip")
    parser.add_argument("--quick", action="store_true", help="a coarse mesh and small pictures, to see that all runs")
    parser.add_argument("--out", type=Path, default=Path("out/roll_up"), help="folder for the results")
    options = parser.parse_args()

    cells = 12 if options.quick else options.cells
    mesh = strip(cells, None).mesh
    problem = strip(cells, two_layers(mesh))
    path = sk.follow(problem, sk.Ramp(6))
    ring = path.equilibria[-1]
    ends = [ring.vertices[jnp.isclose(mesh.vertices[:, 0], x)].mean(0) for x in (0.0, LENGTH)]
    gap = float(jnp.linalg.norm(ends[1] - ends[0])) / LENGTH
    state = "converged" if bool(ring.converged) else sk.RESULTS[ring.result]
    print(f"{len(path.equilibria)} equilibria on the way, the last one {state}.")
    print(f"The layers differ by {100 * MISFIT:.2f} % in length, which turns the strip by 360° if it stays straight")
    print(f"across; the gap that is left between its ends is {gap:.4f} of its length.")

    options.out.mkdir(parents=True, exist_ok=True)
    sk.plot(
        path, color="displacement", size=(300, 240) if options.quick else (600, 480), save=options.out / "roll_up.png"
    )
    print(f"The picture is in {options.out}/")


if __name__ == "__main__":
    main()
