"""Card 8: strips that bend far, against the exact elastica."""

from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np

import shellkit as sk

from ..figures import Figure, timed
from ..meshes import KINDS, Kind, sheet


TITLE = "Elastica"
PROBLEM = (
    "A strip 10 × 1 × 0.1, E = 1.2·10⁶, ν = 0, clamped at one end: displacements of the other under a shear force "
    "P = 4. A strip hanging under its own weight, Γ = ρgL³h/D: height over width of its curve."
)
LENGTH, THICKNESS, YOUNG = 10.0, 0.1, 1.2e6
SHORTENING, DEFLECTION = 3.28941, 6.69964
ASPECT = {10.0: 1.066802, 100.0: 5.888105}
_ALL = ((8, 1), (16, 2), (32, 4), (64, 8))
SIZES = {1: _ALL[:2], 2: _ALL[:3], 3: _ALL[:3], 4: _ALL[1:]}


def cantilever(kind: Kind, cells: tuple[int, int], directors: str = "free", form: str = "sin", load: float = 4.0):
    """The strip along x, clamped at x = 0, with a shear force along z at its end."""
    mesh = sheet(kind, cells, LENGTH, 1.0)
    x = mesh.vertices[:, 0]
    return sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        energy=sk.StVenantKirchhoff.from_young(YOUNG, 0.0)
        + sk.Bending.from_young(YOUNG, 0.0, directors=directors, form=form)
        + sk.EdgeLoad(jnp.isclose(x, LENGTH), force=jnp.array([0.0, 0.0, load])),
        supports=sk.Clamped(jnp.isclose(x, 0.0)),
    )


def hanging(kind: Kind, cells: tuple[int, int], weight: float) -> sk.InverseProblem:
    """The strip clamped at x = 0, with its weight along -z; `weight` is Γ."""
    problem = cantilever(kind, cells, load=0.0)
    force = weight * YOUNG * THICKNESS**3 / 12 / LENGTH**3
    mesh, energy = problem.mesh, problem.energy
    return sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        energy=energy + sk.SurfaceLoad(jnp.array([0.0, 0.0, -force])),
        supports=sk.Clamped(jnp.isclose(mesh.vertices[:, 0], 0.0)),
    )


def tip(equilibrium: sk.Equilibrium) -> np.ndarray:
    """The mean displacement of the end."""
    rest = np.asarray(equilibrium.mesh.vertices)
    return (np.asarray(equilibrium.vertices) - rest)[np.isclose(rest[:, 0], LENGTH)].mean(0)


def relaxed(problem: sk.InverseProblem) -> tuple[sk.Equilibrium, float]:
    """The equilibrium along a ramp of eight steps, and its seconds."""
    equilibrium, seconds = timed(lambda: sk.relax(problem, path=sk.Ramp(8)))
    if not bool(equilibrium.converged):
        raise RuntimeError(f"{problem.mesh.n_vertices} vertices: {sk.RESULTS[equilibrium.result]}")
    return equilibrium, seconds


def measure(level: int) -> Iterator[Figure]:
    """The cantilever on all kinds of meshes, the hanging strip on the jittered one."""
    for kind in KINDS:
        for cells in SIZES[level]:
            equilibrium, seconds = relaxed(cantilever(kind, cells))
            move = tip(equilibrium)
            yield Figure("shortening", f"free, {kind}", cells[0], SHORTENING, -float(move[0]), seconds)
            yield Figure("deflection", f"free, {kind}", cells[0], DEFLECTION, float(move[2]), seconds)
    for weight, exact in ASPECT.items() if level > 1 else ():
        for cells in SIZES[level]:
            equilibrium, seconds = relaxed(hanging("J", cells, weight))
            move = tip(equilibrium)
            aspect = -float(move[2]) / (LENGTH + float(move[0]))
            yield Figure(f"aspect of a hanging strip, Γ = {weight:g}", "free, J", cells[0], exact, aspect, seconds)
