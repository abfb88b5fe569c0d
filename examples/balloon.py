"""A rubber balloon that is pumped up: its pressure rises, passes a greatest one and falls, against the exact sphere.

Pumped to a volume it is stable all the way; blown up by a pressure it would burst past the greatest."""

import argparse
from pathlib import Path

import jax
import matplotlib as mpl
import numpy as np

import shellkit as sk


mpl.use("Agg")
jax.config.update("jax_enable_x64", True)
sk.keep_compiled()

THICKNESS, SHEAR = 0.02, 1.0


def balloon(subdivisions: int, factor: float) -> sk.InverseProblem:
    """A sphere of rubber, to be pumped to so many times its volume."""
    return sk.InverseProblem(
        mesh=sk.meshes.icosphere(subdivisions),
        thickness=THICKNESS,
        energy=sk.IncompressibleNeoHookean(SHEAR)
        + sk.Bending.from_young(3 * SHEAR, poisson=0.5)
        + sk.Inflation(factor),
    )


def exact(stretch: np.ndarray | float) -> np.ndarray | float:
    """p = 2μ h/R (1/λ - 1/λ⁷), for a thin neo-Hookean sphere of radius 1 (Treloar)."""
    return 2 * SHEAR * THICKNESS * (1 / stretch - 1 / stretch**7)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--subdivisions", type=int, default=3, help="of the icosahedron")
    parser.add_argument("--quick", action="store_true", help="a coarse mesh and small pictures, to see that all runs")
    parser.add_argument("--out", type=Path, default=Path("out/balloon"), help="folder for the results")
    options = parser.parse_args()

    problem = balloon(1 if options.quick else options.subdivisions, factor=8.0)
    path = sk.follow(problem, sk.Ramp(5 if options.quick else 20))
    stretch = (1 + 7 * np.asarray(path.progress)) ** (1 / 3)
    pressure = np.array([np.asarray(e.multipliers)[0] for e in path.equilibria])
    ours, theirs = pressure.max(), exact(7 ** (1 / 6))
    print(f"greatest pressure {ours:.5f} at {stretch[pressure.argmax()]:.2f} times the radius;")
    print(f"the exact sphere's is {theirs:.5f} at {7 ** (1 / 6):.2f} times.")
    off = np.max(np.abs(pressure - exact(stretch)) / theirs)
    print(f"Over the whole path the pressure is off by {100 * off:.2f} % of it, on {problem.mesh.n_vertices} vertices.")
    stable = "" if all(e.stable for e in path.equilibria) else " not"
    print(f"Held at its volume the balloon is{stable} stable everywhere.")

    options.out.mkdir(parents=True, exist_ok=True)
    draw(stretch, pressure, options)
    print(f"The picture is in {options.out}/")


def draw(stretch: np.ndarray, pressure: np.ndarray, options: argparse.Namespace) -> None:
    """Pressure against radius."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3.5), layout="constrained")
    fine = np.linspace(1, 2, 200)
    axis.plot(fine, exact(fine), color="#0072b2", label="exact thin sphere")
    axis.plot(stretch, pressure, "o", color="#d55e00", label="shell, held at its volume")
    axis.set(xlabel="radius over that at rest", ylabel="pressure")
    axis.legend(frameon=False)
    figure.savefig(options.out / "balloon.png", dpi=80 if options.quick else 160)


if __name__ == "__main__":
    main()
