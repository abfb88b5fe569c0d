"""Card 8: strips that bend far, against the exact elastica."""

from collections.abc import Iterator

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import shellkit as sk

from ..figures import Figure, timed
from ..meshes import KINDS, Kind, sheet


TITLE = "Elastica"
PROBLEM = (
    "A strip 10 × 1 × 0.1, E = 1.2·10⁶, ν = 0, clamped at one end: displacements of the other under a shear force P = "
    "4. A strip hanging under its own weight, Γ = ρgL³h/D: height over width of its curve. A strip of length 6, half "
    "of a ring, bent by the moment 50π/3 at its end: how far that is from where the ring would be closed. A pinned "
    "strip, h/L = 0.005, its ends brought together by Δ/L = 0.25898: its rise w/L, its load over that of buckling."
)
LENGTH, THICKNESS, YOUNG = 10.0, 0.1, 1.2e6
SHORTENING, DEFLECTION = 3.28941, 6.69964
ASPECT = {10.0: 1.066802, 100.0: 5.888105}
MOMENT, HALF_RING = 50 * np.pi / 3, 6.0
SHORTENED, RISE, LOAD = 0.258980, 0.296604, 1.151720
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


def ring(kind: Kind, cells: tuple[int, int]) -> sk.InverseProblem:
    """Half of a ring: clamped at x = 0, and a moment at the other end that turns it by half a circle."""
    mesh = sheet(kind, cells, HALF_RING, 1.0)
    x = mesh.vertices[:, 0]
    bending = sk.Bending.from_young(YOUNG, 0.0, directors="free")
    moment = sk.EdgeMoment(jnp.isclose(x, HALF_RING), moment=MOMENT, centre=0.5)
    return sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        energy=sk.StVenantKirchhoff.from_young(YOUNG, 0.0) + bending + moment,
        supports=sk.Clamped(jnp.isclose(x, 0.0)),
    )


def open_by(equilibrium: sk.Equilibrium) -> float:
    """How far the end of half a ring is from the point opposite its beginning, in units of the ring's diameter."""
    move = tip(equilibrium, HALF_RING) + np.array([HALF_RING, 0.0, 0.0])
    diameter = 2 * HALF_RING / np.pi
    return float(np.hypot(move[0], abs(move[2]) - diameter) / diameter)


def buckled(kind: Kind, cells: tuple[int, int]) -> tuple[sk.InverseProblem, sk.Equilibrium]:
    """A strip of length one, its pinned ends brought together; and an arch of that length to start from."""
    mesh = sheet(kind, cells, 1.0, 0.2)
    rest = np.asarray(mesh.vertices)
    x = mesh.vertices[:, 0]
    problem = sk.InverseProblem(
        mesh=mesh,
        thickness=0.005,
        energy=sk.StVenantKirchhoff.from_young(1.0, 0.0) + sk.Bending.from_young(1.0, 0.0, directors="free"),
        supports=sk.Pinned(jnp.isclose(x, 0.0))
        + sk.Pinned(jnp.isclose(x, 1.0), displacement=jnp.array([-SHORTENED, 0.0, 0.0])),
    )
    # An arch of slope a cos πx, its amplitude such that the ends are where they are held.
    fine = np.linspace(0.0, 1.0, 2001)
    across = lambda a: np.cos(a * np.cos(np.pi * fine))
    low, high = 0.0, np.pi / 2
    for _ in range(50):
        a = 0.5 * (low + high)
        low, high = (a, high) if np.trapezoid(across(a), fine) > 1 - SHORTENED else (low, a)
    arc = lambda slope: np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(fine))])
    run, rise = arc(across(a)), arc(np.sin(a * np.cos(np.pi * fine)))
    points = np.stack([np.interp(rest[:, 0], fine, run), rest[:, 1], np.interp(rest[:, 0], fine, rise)], axis=1)
    return problem, eqx.tree_at(lambda e: e.vertices, problem.unrelaxed(), jnp.asarray(points))


def arch(problem: sk.InverseProblem, equilibrium: sk.Equilibrium) -> tuple[float, float]:
    """The rise of a buckled strip over its length, and its load over that of buckling, π²EI/L²."""
    rest = np.asarray(problem.mesh.vertices)
    left = np.isclose(rest[:, 0], 0.0)
    load = np.asarray(equilibrium.reactions)[left, 0].sum()
    return float(np.asarray(equilibrium.vertices)[:, 2].max()), float(load / (np.pi**2 * 0.2 * 0.005**3 / 12))


def tip(equilibrium: sk.Equilibrium, length: float = LENGTH) -> np.ndarray:
    """The mean displacement of the end."""
    rest = np.asarray(equilibrium.mesh.vertices)
    return (np.asarray(equilibrium.vertices) - rest)[np.isclose(rest[:, 0], length)].mean(0)


def relaxed(problem: sk.InverseProblem, start: sk.Equilibrium | None = None) -> tuple[sk.Equilibrium, float]:
    """The equilibrium along a ramp of eight steps, or from a start at once; and its seconds."""
    path = sk.Ramp(8) if start is None else None
    equilibrium, seconds = timed(lambda: sk.relax(problem, path=path, start=start))
    if not bool(equilibrium.converged):
        raise RuntimeError(f"{problem.mesh.n_vertices} vertices: {sk.RESULTS[equilibrium.result]}")
    return equilibrium, seconds


def measure(level: int) -> Iterator[Figure]:
    """The cantilever, half a ring and the buckled strip on all meshes, the hanging strip on the jittered one."""
    for kind in KINDS:
        for cells in SIZES[level]:
            equilibrium, seconds = relaxed(cantilever(kind, cells))
            move = tip(equilibrium)
            yield Figure("shortening", f"free, {kind}", cells[0], SHORTENING, -float(move[0]), seconds)
            yield Figure("deflection", f"free, {kind}", cells[0], DEFLECTION, float(move[2]), seconds)
            equilibrium, seconds = relaxed(ring(kind, cells))
            yield Figure("half a ring, open by", f"free, {kind}", cells[0], 0.0, open_by(equilibrium), seconds)
            problem, start = buckled(kind, cells)
            equilibrium, seconds = relaxed(problem, start)
            rise, load = arch(problem, equilibrium)
            yield Figure("rise of a buckled strip", f"free, {kind}", cells[0], RISE, rise, seconds)
            yield Figure("load of a buckled strip", f"free, {kind}", cells[0], LOAD, load, seconds)
    for weight, exact in ASPECT.items() if level > 1 and "J" in KINDS else ():
        for cells in SIZES[level]:
            equilibrium, seconds = relaxed(hanging("J", cells, weight))
            move = tip(equilibrium)
            aspect = -float(move[2]) / (LENGTH + float(move[0]))
            yield Figure(f"aspect of a hanging strip, Γ = {weight:g}", "free, J", cells[0], exact, aspect, seconds)
