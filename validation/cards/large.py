"""Card 9: thin shells that are moved by as much as their size, against published values."""

from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np

import shellkit as sk

from ..figures import Figure, timed
from ..meshes import KINDS, Kind, curved, sheet


TITLE = "Large displacements"
PROBLEM = (
    "K. Y. Sze, X. H. Liu and S. H. Lo, Finite Elem. Anal. Des. 40 (2004), 1551. A slit annulus, radii 6 and 10, h = "
    "0.03, E = 21·10⁶, ν = 0, clamped at one side of the slit and lifted at the other by 0.8 a length: how far the "
    "inner and the outer corner rise. A hemisphere with a hole of 18°, R = 10, h = 0.04, E = 6.825·10⁷, ν = 0.3, "
    "pulled outwards at two points of its rim and pushed inwards at two between, by P = 400 each and by half of that; "
    "a quarter."
)
ANNULUS = {"inner corner": 13.891, "outer corner": 17.528}
HEMISPHERE = {1.0: {"outwards": 4.067, "inwards": 8.178}, 0.5: {"outwards": 3.406, "inwards": 5.902}}
SIZES = {1: (4, 6), 2: (6, 8), 3: (8, 12, 16), 4: (8, 12, 16, 24)}


def _energy(young: float, poisson: float, directors: str, form: str) -> sk.EnergyTerm:
    return sk.StVenantKirchhoff.from_young(young, poisson) + sk.Bending.from_young(
        young, poisson, directors=directors, form=form
    )


def annulus(kind: Kind, cells: int, directors: str = "free", form: str = "sin") -> sk.InverseProblem:
    """The whole annulus; its slit lies along x."""
    flat = sheet(kind, (8 * cells, cells), 2 * np.pi, 4.0)
    chart = lambda p: np.stack([(6 + p[:, 1]) * np.cos(p[:, 0]), (6 + p[:, 1]) * np.sin(p[:, 0]), 0 * p[:, 0]], axis=1)
    angle = flat.vertices[:, 0]
    return sk.InverseProblem(
        mesh=curved(flat, chart),
        thickness=0.03,
        energy=_energy(21e6, 0.0, directors, form)
        + sk.EdgeLoad(jnp.isclose(angle, 2 * np.pi), force=jnp.array([0.0, 0.0, 3.2])),
        supports=sk.Clamped(jnp.isclose(angle, 0.0)),
    )


def lifted(problem: sk.InverseProblem, equilibrium: sk.Equilibrium) -> dict[str, float]:
    """How far the two corners at the free side of the slit have risen; they are those held by no support."""
    rest, heights = np.asarray(problem.mesh.vertices), np.asarray(equilibrium.vertices)[:, 2]
    corner = lambda radius: np.flatnonzero(np.isclose(rest[:, 0], radius) & np.isclose(rest[:, 1], 0.0, atol=1e-9))
    return {name: float(heights[corner(radius)].max()) for name, radius in zip(ANNULUS, (6.0, 10.0), strict=True)}


def hemisphere(kind: Kind, cells: int, directors: str = "free", form: str = "sin") -> sk.InverseProblem:
    """A quarter, between the planes x = 0 and y = 0. The points of the forces lie in them, and carry half of each."""
    flat = sheet(kind, (cells, cells), np.pi / 2, np.deg2rad(72.0))

    def chart(p):
        azimuth, elevation = p.T
        ring = np.cos(elevation)
        return 10 * np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), np.sin(elevation)], axis=1)

    azimuth, elevation = flat.vertices[:, 0], flat.vertices[:, 1]
    rim = jnp.isclose(elevation, 0.0)
    outwards, inwards = rim & jnp.isclose(azimuth, 0.0), rim & jnp.isclose(azimuth, np.pi / 2)
    return sk.InverseProblem(
        mesh=curved(flat, chart),
        thickness=0.04,
        energy=_energy(6.825e7, 0.3, directors, form)
        + sk.PointLoad(jnp.flatnonzero(outwards), force=jnp.array([200.0, 0.0, 0.0]))
        + sk.PointLoad(jnp.flatnonzero(inwards), force=jnp.array([0.0, -200.0, 0.0])),
        supports=sk.Symmetry(jnp.isclose(azimuth, 0.0), normal="y")
        + sk.Symmetry(jnp.isclose(azimuth, np.pi / 2), normal="x"),
    )


def moved(problem: sk.InverseProblem, equilibrium: sk.Equilibrium) -> dict[str, float]:
    """How far the two points of the forces have moved, each along its own."""
    rest, now = np.asarray(problem.mesh.vertices), np.asarray(equilibrium.vertices)
    at = lambda point: np.argmin(np.linalg.norm(rest - np.array(point), axis=1))
    outwards, inwards = at((10.0, 0.0, 0.0)), at((0.0, 10.0, 0.0))
    return {"outwards": float(now[outwards, 0] - 10), "inwards": float(10 - now[inwards, 1])}


def loaded(problem: sk.InverseProblem, steps: int) -> tuple[sk.Path, float]:
    """The path to the full load, and its seconds."""
    path, seconds = timed(lambda: sk.follow(problem, path=sk.Ramp(steps)))
    if not path.complete:
        raise RuntimeError(f"{problem.mesh.n_vertices} vertices: the path ended early\n{path}")
    return path, seconds


def at_half(path: sk.Path) -> sk.Equilibrium:
    """The equilibrium at half the load."""
    return path.equilibria[int(jnp.argmin(jnp.abs(path.progress - 0.5)))]


def measure(level: int, kinds=KINDS) -> Iterator[Figure]:
    """Both shells on all kinds of meshes."""
    for kind in kinds:
        label = f"free, {kind}"
        for cells in SIZES[level]:
            problem = annulus(kind, cells)
            path, seconds = loaded(problem, 8)
            for name, ours in lifted(problem, path.equilibria[-1]).items():
                yield Figure(f"annulus, {name}", label, cells, ANNULUS[name], ours, seconds)
        for cells in SIZES[level]:
            problem = hemisphere(kind, 3 * cells)
            path, seconds = loaded(problem, 10)
            for part, equilibrium in ((1.0, path.equilibria[-1]), (0.5, at_half(path))):
                for name, ours in moved(problem, equilibrium).items():
                    quantity = f"hemisphere, {name}, P = {400 * part:g}"
                    yield Figure(quantity, label, 3 * cells, HEMISPHERE[part][name], ours, seconds)
