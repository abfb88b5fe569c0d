"""A flat disc whose directors run round its centre becomes a cone when it is heated: the shape that made nematic sheets
famous, against the exact shell of revolution."""

import argparse
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import shellkit as sk


jax.config.update("jax_enable_x64", True)
sk.keep_compiled()

THICKNESS, STRETCH = 0.02, 0.9
# The exact axisymmetric shell of that thickness: height, half-angle at half the way to the rim, energy.
EXACT = (0.634464, 54.096, 4.59148e-6)


def disc(edge: float) -> sk.InverseProblem:
    """A disc of radius 1 with directors round its centre: it shrinks along them and grows outwards."""
    mesh = sk.meshes.disc(radius=1.0, target_edge_length=edge)
    round_the_centre = jnp.cross(jnp.array([0.0, 0.0, 1.0]), mesh.vertices[mesh.faces].mean(1))
    return sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        actuation=sk.Nematic(angle=sk.director_angles(mesh, round_the_centre), stretch=STRETCH),
        energy=sk.StVenantKirchhoff.from_young(young=1.0, poisson=0.3)
        + sk.Bending.from_young(young=1.0, poisson=0.3, directors="free"),
    )


def measure(problem: sk.InverseProblem, cone: sk.Equilibrium) -> tuple[float, float]:
    """Height of the cone, and its half-angle in degrees where the distance along it was a half."""
    centred = cone.vertices - cone.vertices.mean(0)
    axis = jnp.linalg.svd(centred)[2][2]
    along = centred @ axis
    r = jnp.linalg.norm(centred - along[:, None] * axis, axis=1)
    s = jnp.linalg.norm(problem.mesh.vertices, axis=1)
    near = (s > 0.4) & (s < 0.6)
    slope = np.polyfit(np.asarray(r[near]), np.asarray(along[near]), 1)[0]
    return float(jnp.ptp(along)), float(np.degrees(np.arctan(1 / abs(slope))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--edge", type=float, default=0.04, help="length of the edges of the mesh")
    parser.add_argument("--quick", action="store_true", help="a coarse mesh and small pictures, to see that all runs")
    parser.add_argument("--out", type=Path, default=Path("out/cone"), help="folder for the results")
    options = parser.parse_args()

    problem = disc(0.12 if options.quick else options.edge)
    cone = problem()
    height, angle = measure(problem, cone)
    state = "a minimum" if cone.stable else "not stable"
    print(f"The flat disc is a saddle; {int(cone.steps)} steps of Newton's lead to {state}.")
    print(f"height      {height:.4f}     exact {EXACT[0]:.4f}")
    print(f"half-angle  {angle:.2f}°     exact {EXACT[1]:.2f}°; sin φ = λ² as h → 0: ", end="")
    print(f"{np.degrees(np.arcsin(STRETCH**2)):.2f}°")
    print(f"energy      {float(cone.energy):.3e}  exact {EXACT[2]:.3e}")
    print("The energy is too large by the square of edge over thickness: one director per face fits no smooth cone.")

    options.out.mkdir(parents=True, exist_ok=True)
    sk.plot(problem, size=(300, 300) if options.quick else (800, 640), save=options.out / "cone_directors.png")
    sk.plot(cone, color="displacement", size=(300, 300) if options.quick else (800, 640), save=options.out / "cone.png")
    print(f"The pictures are in {options.out}/")


if __name__ == "__main__":
    main()
