"""Card 1: what the moduli mean, on a random flat patch under an affine strain."""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

import shellkit as sk

from ..figures import Figure, timed
from ..meshes import sheet


TITLE = "Moduli"
PROBLEM = (
    "A jittered flat patch under an affine strain: uniaxial stress, the stiffness of a plate, any large affine map, "
    "and the stiffness of both materials at rest. E = 1.7, ν = 0.3, h = 0.02."
)
YOUNG, POISSON, THICKNESS, STRAIN = 1.7, 0.3, 0.02, 1e-4
MATERIALS = {"StVenantKirchhoff": sk.StVenantKirchhoff, "NeoHookean": sk.NeoHookean}


def patch(energy) -> sk.InverseProblem:
    """A jittered unit square of one energy."""
    return sk.InverseProblem(mesh=sheet("J", (6, 6), seed=3), thickness=THICKNESS, energy=energy)


def uniaxial(material) -> tuple[float, float]:
    """Energy of an area under a small uniaxial stress, and Poisson's ratio from the strain across."""
    problem = patch(material.from_young(YOUNG, POISSON))

    def energy(across):
        return problem.total_energy(problem.mesh.vertices * jnp.stack([1 + STRAIN, 1 + across, jnp.ones(())]))

    across = jnp.asarray(-POISSON * STRAIN)
    newton = jax.jit(lambda x: x - jax.grad(energy)(x) / jax.grad(jax.grad(energy))(x))
    for _ in range(3):
        across = newton(across)
    return float(energy(across)), -float(across) / STRAIN


def affine() -> tuple[float, float]:
    """Energy of a large affine map, and the exact one."""
    alpha, beta = 0.7, 1.1
    problem = patch(sk.StVenantKirchhoff(alpha, beta))
    map_ = np.array([[1.2, 0.3], [-0.1, 0.8], [0.2, -0.4]])
    strain = map_.T @ map_ - np.eye(2)
    exact = THICKNESS / 4 * (alpha * np.trace(strain) ** 2 + 2 * beta * np.trace(strain @ strain))
    return float(problem.total_energy(problem.mesh.vertices[:, :2] @ map_.T)), float(exact)


def materials_differ() -> float:
    """The largest difference between the Hessians of both materials at rest, relative to the largest entry."""
    first, second = (patch(material.from_young(YOUNG, POISSON)) for material in (sk.StVenantKirchhoff, sk.NeoHookean))
    a, b = (p.hessian(p.mesh.vertices).values for p in (first, second))
    return float(jnp.abs(a - b).max() / jnp.abs(a).max())


def plate_stiffness() -> tuple[float, float]:
    """Energy of an area of a flat plate that would like to be a cylinder of unit radius, half of D, and the exact."""
    mesh = sheet("J", (6, 6), seed=3)
    edges = mesh.vertices[mesh.faces[:, 1:]] - mesh.vertices[mesh.faces[:, :1]]
    rest = jnp.einsum("fi,fj->fij", edges[:, :, 0], edges[:, :, 0])
    problem = sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        actuation=sk.Prescribed(curvature=rest),
        energy=sk.Bending.from_young(YOUNG, POISSON, directors="free"),
    )
    return float(problem.total_energy(mesh.vertices)), YOUNG * THICKNESS**3 / 24 / (1 - POISSON**2)


def measure(level: int) -> Iterator[Figure]:
    """All of it on one mesh, whatever the level."""
    for name, material in MATERIALS.items():
        (density, ratio), seconds = timed(lambda material=material: uniaxial(material))
        yield Figure("energy under uniaxial stress", name, 0, 0.5 * YOUNG * THICKNESS * STRAIN**2, density, seconds)
        yield Figure("strain across over strain along", name, 0, POISSON, ratio, seconds)
    (value, exact), seconds = timed(affine)
    yield Figure("energy of a large affine map", "StVenantKirchhoff", 0, exact, value, seconds)
    (value, exact), seconds = timed(plate_stiffness)
    yield Figure("bending energy, D/2", "free directors", 0, exact, value, seconds)
    value, seconds = timed(materials_differ)
    yield Figure("difference of the Hessians at rest", "StVenantKirchhoff, NeoHookean", 0, 0.0, value, seconds)
