"""The hard cases: random meshes, thin shells, odd units, noisy starts, crushed faces, folded hinges.

All cases of one kind share the connectivity of their mesh, so that one compiled program relaxes them all.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import shellkit as sk


@dataclass(frozen=True)
class Case:
    """One relaxation: a shell, and where it starts if not at rest."""

    label: str
    problem: sk.InverseProblem
    start: sk.Equilibrium | None = None


MATERIALS: dict[str, Callable[[], sk.EnergyTerm]] = {
    "neo-Hookean, tan, free": lambda: (
        sk.NeoHookean.from_young(1.0, 0.3) + sk.Bending.from_young(1.0, 0.3, form="tan", directors="free")
    ),
    "StVK, sin, average": lambda: sk.StVenantKirchhoff.from_young(1.0, 0.3) + sk.Bending.from_young(1.0, 0.3),
}
MAX_STEPS = 150


def shell(mesh: sk.Mesh, thickness: float, material: str, stretch: np.ndarray | None = None) -> sk.InverseProblem:
    """A free shell whose faces grow by a factor each."""
    growth = np.ones(mesh.n_faces) if stretch is None else stretch
    return sk.InverseProblem(
        mesh=mesh,
        thickness=thickness,
        actuation=sk.IsotropicGrowth(jnp.asarray(growth)),
        energy=MATERIALS[material](),
        solver=sk.SparseNewton(max_steps=MAX_STEPS),
    )


def started(problem: sk.InverseProblem, vertices: np.ndarray) -> sk.Equilibrium:
    """A start at given vertices, with the directors in the middle."""
    directors = jnp.zeros(problem.assembly.dofs.n_directors) if problem.assembly.dofs.n_directors else None
    return eqx.tree_at(
        lambda e: (e.vertices, e.directors),
        problem.unrelaxed(),
        (jnp.asarray(vertices), directors),
        is_leaf=lambda x: x is None,
    )


def _patch(points: np.ndarray) -> sk.Mesh:
    return sk.meshes.rectangle(1.0, 1.0, cells=(3, 3), diagonals="alternating").with_vertices(points)


def random_sheets(material: str, count: int, seed: int = 0) -> Iterator[Case]:
    """Needles, near-duplicates and obtuse angles, any thickness, faces that grow to .3 to 3 times their size."""
    flat = np.asarray(_patch(sk.meshes.rectangle(1.0, 1.0, cells=(3, 3)).vertices).vertices)
    random = np.random.default_rng(seed)
    for number in range(count):
        kind = ("obtuse", "needle", "near-duplicate")[number % 3]
        points = flat + 0.08 * random.normal(size=flat.shape) * [1, 1, 0.3]
        if kind == "needle":
            points *= [1.0, 10.0 ** -random.uniform(0, 4), 1.0]
        if kind == "near-duplicate":
            points[5] = points[6] + 10.0 ** -random.uniform(1, 5) * random.normal(size=3)
        size = np.ptp(points, axis=0).max()
        thickness = size * 10.0 ** -random.uniform(1, 5)
        faces = 18
        stretch = np.exp(random.uniform(np.log(0.3), np.log(3.0)) + 0.2 * random.normal(size=faces))
        yield Case(kind, shell(_patch(points), thickness, material, stretch))


def bent(material: str, thickness: float = 0.1, scale: float = 1.0) -> sk.InverseProblem:
    """A bent sheet whose faces grow unevenly, by five per cent or so."""
    flat = np.asarray(sk.meshes.rectangle(1.0, 1.0, cells=(3, 3)).vertices)
    points = flat + np.stack([0 * flat[:, 0], 0 * flat[:, 0], 0.15 * flat[:, 0] * flat[:, 1]], axis=1)
    stretch = 1 + 0.05 * np.random.default_rng(0).normal(size=18)
    return shell(_patch(scale * points), scale * thickness, material, stretch)


def thicknesses(material: str, count: int = 9) -> Iterator[Case]:
    """Growth that no shape in space satisfies, from thick to thin: as h vanishes, the sheet wants to crumple."""
    for thickness in np.logspace(-1, -5, count):
        yield Case(f"h = {thickness:.0e}", bent(material, thickness))


def strips(material: str, count: int = 9) -> Iterator[Case]:
    """A clamped strip under a load that goes with h³, which bends it to the same curve at any thickness."""
    mesh = sk.meshes.rectangle(1.0, 0.25, cells=(8, 2), diagonals="alternating")
    x = mesh.vertices[:, 0]
    for thickness in np.logspace(-1, -5, count):
        problem = sk.InverseProblem(
            mesh=mesh,
            thickness=thickness,
            energy=MATERIALS[material]()
            + sk.EdgeLoad(jnp.isclose(x, 1.0), force=jnp.array([0.0, 0.0, 0.02 * thickness**3])),
            supports=sk.Clamped(jnp.isclose(x, 0.0)),
            solver=sk.SparseNewton(max_steps=MAX_STEPS),
        )
        yield Case(f"h = {thickness:.0e}", problem)


def units(material: str, count: int = 7) -> Iterator[Case]:
    """The same shell in other units of length."""
    for scale in np.logspace(-6, 6, count):
        yield Case(f"scale {scale:.0e}", bent(material, scale=scale))


def noisy_starts(material: str, count: int = 8) -> Iterator[Case]:
    """The same shell from starts off by 10 % and 50 % of an edge."""
    problem = bent(material)
    rest = np.asarray(problem.mesh.vertices)
    random = np.random.default_rng(0)
    for number in range(count):
        size = (0.1, 0.5)[number % 2]
        yield Case(f"noise {size}", problem, started(problem, rest + size / 3 * random.normal(size=rest.shape)))


def crushed(material: str, count: int = 6) -> Iterator[Case]:
    """Starts with all faces crushed along x, to a hundredth of their width at the worst, and stretched along y."""
    problem = bent(material)
    rest = np.asarray(problem.mesh.vertices)
    for squeeze in np.logspace(-0.5, -2, count):
        yield Case(f"crushed to {squeeze:.2g}", problem, started(problem, rest * [squeeze, 1.3, 1.0]))


def folded(material: str, count: int = 4) -> Iterator[Case]:
    """Starts folded along a line, by up to a half turn."""
    problem = bent(material)
    rest = np.asarray(problem.mesh.vertices)
    beyond = np.maximum(rest[:, 0] - 1 / 3, 0.0)
    for angle in np.deg2rad([90.0, 150.0, 179.0, 180.0][:count]):
        points = rest.copy()
        points[:, 0] = np.minimum(rest[:, 0], 1 / 3) + beyond * np.cos(angle)
        points[:, 2] += beyond * np.sin(angle)
        yield Case(f"folded by {np.rad2deg(angle):.0f}°", problem, started(problem, points))


def cones(material: str, count: int = 6) -> Iterator[Case]:
    """Flat discs whose directors run around the centre: flat is a saddle of the energy, and the start."""
    disc = sk.meshes.disc(radius=1.0, target_edge_length=0.25)
    field = jnp.cross(jnp.array([0.0, 0.0, 1.0]), disc.vertices[disc.faces].mean(1))
    angle = sk.director_angles(disc, field)
    for stretch in np.linspace(0.95, 0.7, count):
        problem = sk.InverseProblem(
            mesh=disc,
            thickness=0.05,
            actuation=sk.Nematic(angle=angle, stretch=float(stretch)),
            energy=MATERIALS[material](),
            solver=sk.SparseNewton(max_steps=MAX_STEPS),
        )
        yield Case(f"λ = {stretch:.2f}", problem)


def pressurised(material: str, count: int = 6) -> Iterator[Case]:
    """Spheres under a pressure from outside, up to and beyond the one at which a perfect sphere buckles."""
    thickness = 0.05
    critical = 2 * thickness**2 / np.sqrt(3 * (1 - 0.3**2))
    for part in (0.5, 0.9, 0.98, 1.02, 1.1, 0.99)[:count]:
        problem = sk.InverseProblem(
            mesh=sk.meshes.icosphere(2),
            thickness=thickness,
            energy=MATERIALS[material]() + sk.Pressure(-part * critical),
            solver=sk.SparseNewton(max_steps=MAX_STEPS),
        )
        yield Case(f"{part:.0%} of the critical pressure", problem)


KINDS: dict[str, tuple[Callable[..., Iterator[Case]], int]] = {
    "random sheets": (random_sheets, 60),
    "strip of any thickness": (strips, 9),
    "misfit of any thickness": (thicknesses, 9),
    "unit of length from 1e-6 to 1e6": (units, 7),
    "starts with noise": (noisy_starts, 12),
    "starts with crushed faces": (crushed, 6),
    "starts folded": (folded, 4),
    "flat discs that become cones": (cones, 6),
    "sphere near its critical pressure": (pressurised, 6),
}
