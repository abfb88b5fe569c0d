"""A strip that is clamped at one end and bent far by a force at the other, against the exact elastica."""

import argparse
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
from scipy.integrate import solve_bvp

import shellkit as sk


mpl.use("Agg")
jax.config.update("jax_enable_x64", True)
sk.keep_compiled()

LENGTH, WIDTH, THICKNESS, YOUNG, FORCE = 10.0, 1.0, 0.1, 1.2e6, 4.0


def strip(cells: int) -> sk.InverseProblem:
    """The strip along x, with a total force along z spread over its free end."""
    mesh = sk.meshes.rectangle(length=LENGTH, width=WIDTH, cells=(cells, max(1, cells // 10)))
    x = mesh.vertices[:, 0]
    return sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        energy=sk.StVenantKirchhoff.from_young(YOUNG, poisson=0.0)
        + sk.Bending.from_young(YOUNG, poisson=0.0, directors="free")
        + sk.EdgeLoad(jnp.isclose(x, LENGTH), force=jnp.array([0.0, 0.0, FORCE])),
        supports=sk.Clamped(jnp.isclose(x, 0.0)),
    )


def elastica(force: float) -> tuple[float, float]:
    """How far the end of the exact elastica, EI θ'' = -P cos θ, comes back and goes up."""
    stiffness = YOUNG * WIDTH * THICKNESS**3 / 12
    s = np.linspace(0, LENGTH, 201)
    rates = lambda s, y: np.stack([y[1], -force / stiffness * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])])
    ends = lambda a, b: np.array([a[0], b[1], a[2], a[3]])
    guess = np.stack([0.5 * s / LENGTH, np.full_like(s, 0.5 / LENGTH), s, 0.2 * s])
    end = solve_bvp(rates, ends, s, guess, tol=1e-10, max_nodes=100_000).y[:, -1]
    return LENGTH - end[2], end[3]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, default=40, help="along the strip")
    parser.add_argument("--quick", action="store_true", help="a coarse mesh and small pictures, to see that all runs")
    parser.add_argument("--out", type=Path, default=Path("out/cantilever"), help="folder for the results")
    options = parser.parse_args()

    problem = strip(10 if options.quick else options.cells)
    mesh = problem.mesh
    end = np.isclose(mesh.vertices[:, 0], LENGTH)
    path = sk.follow(problem, sk.Ramp(8))
    moved = np.array([np.mean((e.vertices - mesh.vertices)[end], axis=0) for e in path.equilibria])
    exact = np.array([elastica(FORCE * progress) for progress in path.progress])
    print("  force   back: ours, exact      up: ours, exact")
    for progress, ours, theirs in zip(path.progress, moved, exact, strict=True):
        print(f"  {FORCE * progress:5.2f}   {-ours[0]:8.5f} {theirs[0]:8.5f}   {ours[2]:8.5f} {theirs[1]:8.5f}")
    off = max(abs(-moved[-1, 0] / exact[-1, 0] - 1), abs(moved[-1, 2] / exact[-1, 1] - 1))
    print(f"At the full force the end is off by {100 * off:.2f} %, on {mesh.n_vertices} vertices.")

    options.out.mkdir(parents=True, exist_ok=True)
    draw(path, moved, options)
    print(f"The pictures are in {options.out}/")


def draw(path: sk.Path, moved: np.ndarray, options: argparse.Namespace) -> None:
    """The load against the way of the end, and the bent strip."""
    import matplotlib.pyplot as plt

    forces = np.linspace(0.02, FORCE, 20)
    exact = np.array([elastica(force) for force in forces])
    figure, axis = plt.subplots(figsize=(6, 3.5), layout="constrained")
    for column, sign, name, colour in ((0, -1, "back", "#0072b2"), (2, 1, "up", "#d55e00")):
        axis.plot(exact[:, column // 2], forces, color=colour, label=f"{name}, exact elastica")
        axis.plot(sign * moved[:, column], FORCE * np.asarray(path.progress), "o", color=colour, label=f"{name}, shell")
    axis.set(xlabel="way of the end", ylabel="force")
    axis.legend(frameon=False)
    figure.savefig(options.out / "cantilever_force.png", dpi=80 if options.quick else 160)
    sk.plot(
        path.equilibria[-1],
        color="displacement",
        size=(300, 240) if options.quick else (900, 640),
        save=options.out / "cantilever.png",
    )


if __name__ == "__main__":
    main()
