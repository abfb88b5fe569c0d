"""Card 3: flat sheets that roll up, wide ones and bilayers among them, and layers that make a given shape exactly."""

from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np

import shellkit as sk

from ..figures import Figure, timed
from ..meshes import KINDS, Kind, curved, sheet
from .consistency import saddle


TITLE = "Rolling up"
PROBLEM = (
    "A sheet 1 × 0.3, h = 0.01, that would like to be a closed cylinder, b_r = diag(2π, 0): the gap left between its "
    "ends, its radius 1/2π, and its energy, in units of what it stored when flat. A wide sheet, b_r = diag(κ₁, κ₂), "
    "its sides kept in planes: it bends by k = κ₁ + νκ₂ along one axis only, and keeps Eh³κ₂²/24 an area. A strip of "
    "two layers that differ by Δε in length: κ = 3Δε/2h (Timoshenko). The two layers that make a given shape exactly: "
    "the energy there, in units of that of the flat sheet."
)
WIDTH, THICKNESS, POISSON = 0.3, 0.01, 0.3
RADIUS = 1 / (2 * np.pi)
WIDE = (2.0, 0.8)
MISFIT = 0.01
BENDING = ("free", "sin"), ("free", "tan"), ("average", "sin")
SIZES = {1: (8, 16), 2: (8, 16, 32), 3: (16, 32, 64), 4: (16, 32, 64)}


def curvature(mesh: sk.Mesh, along: float, across: float = 0.0):
    """The curvature form diag(along, across) of a flat sheet, in the basis of each face."""
    edges = mesh.vertices[mesh.faces[:, 1:]] - mesh.vertices[mesh.faces[:, :1]]
    return jnp.einsum("fia,a,fja->fij", edges[:, :, :2], jnp.array([along, across]), edges[:, :, :2])


def _energy(directors: str, form: str) -> sk.EnergyTerm:
    return sk.StVenantKirchhoff.from_young(1.0, POISSON) + sk.Bending.from_young(
        1.0, POISSON, directors=directors, form=form
    )


def cells_of(cells: int, width: float) -> tuple[int, int]:
    """Nearly square cells on a sheet of length one."""
    return cells, max(2, round(width * cells))


def roll(
    kind: Kind, cells: int, directors: str = "free", form: str = "sin", turn: float = 2 * np.pi
) -> sk.InverseProblem:
    """The sheet that would like to turn by so much along its length."""
    mesh = sheet(kind, cells_of(cells, WIDTH), 1.0, WIDTH)
    return sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        actuation=sk.Prescribed(curvature=curvature(mesh, turn)),
        energy=_energy(directors, form),
    )


def wide(kind: Kind, cells: int, directors: str = "free", form: str = "sin") -> sk.InverseProblem:
    """A square part of a wide sheet: its sides stay in planes that it meets at right angles."""
    mesh = sheet(kind, (cells, cells))
    y = mesh.vertices[:, 1]
    return sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        actuation=sk.Prescribed(curvature=curvature(mesh, *WIDE)),
        energy=_energy(directors, form),
        supports=sk.Symmetry(jnp.isclose(y, 0.0), normal="y") + sk.Symmetry(jnp.isclose(y, 1.0), normal="y"),
    )


def timoshenko(kind: Kind, cells: int, directors: str = "free", form: str = "sin") -> sk.InverseProblem:
    """A strip of two layers of which the upper is longer by the misfit."""
    mesh = sheet(kind, cells_of(cells, WIDTH), 1.0, WIDTH)
    angle = sk.director_angles(mesh, jnp.array([1.0, 0.0, 0.0]))
    layer = lambda sign: sk.OrthotropicGrowth(angle, along=1 + sign * MISFIT / 2, across=1.0)
    return sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        actuation=sk.Bilayer(top=layer(1.0), bottom=layer(-1.0)),
        energy=_energy(directors, form),
    )


def exact_layers(kind: Kind, cells: int, form: str = "sin") -> tuple[float, float]:
    """The energy that two layers leave at the saddle they were made for, and that of the flat sheet."""
    flat = sheet(kind, (cells, cells))
    target = curved(flat, saddle).vertices
    problem = sk.InverseProblem(
        mesh=flat,
        thickness=0.05,
        actuation=sk.bilayer_inverse(flat, target, 0.05, form=form),
        energy=_energy("average", form),
    )
    return float(problem.total_energy(target)), float(problem.total_energy(flat.vertices))


def rolled(problem: sk.InverseProblem, steps: int = 16) -> tuple[sk.Equilibrium, float]:
    """The equilibrium along a ramp, and its seconds."""
    equilibrium, seconds = timed(lambda: sk.relax(problem, path=sk.Ramp(steps)))
    if not bool(equilibrium.converged):
        raise RuntimeError(f"{problem.mesh.n_vertices} vertices: {sk.RESULTS[equilibrium.result]}")
    return equilibrium, seconds


def gap(equilibrium: sk.Equilibrium) -> float:
    """The larger of the distances between the corners that should meet."""
    rest, now = np.asarray(equilibrium.mesh.vertices), np.asarray(equilibrium.vertices)
    corner = lambda x, y: now[np.argmin(np.hypot(rest[:, 0] - x, rest[:, 1] - y))]
    return float(max(np.linalg.norm(corner(0.0, y) - corner(1.0, y)) for y in (0.0, WIDTH)))


def radius(equilibrium: sk.Equilibrium) -> float:
    """The mean distance of the vertices from the axis, itself that of the circle that fits best."""
    rest, now = np.asarray(equilibrium.mesh.vertices), np.asarray(equilibrium.vertices)
    design = np.column_stack(
        [np.ones(len(rest)), rest[:, 1], np.cos(2 * np.pi * rest[:, 0]), np.sin(2 * np.pi * rest[:, 0])]
    )
    axis = np.linalg.lstsq(design, now, rcond=None)[0][1]
    axis /= np.linalg.norm(axis)
    flat = now - np.outer(now @ axis, axis)
    across = np.linalg.svd(flat - flat.mean(0), full_matrices=False)[2][:2]
    points = flat @ across.T
    middle = np.linalg.lstsq(np.column_stack([2 * points, np.ones(len(points))]), (points**2).sum(1), rcond=None)[0][:2]
    return float(np.linalg.norm(points - middle, axis=1).mean())


def bend(equilibrium: sk.Equilibrium) -> float:
    """The curvature of the arc of length one whose ends are as far apart as those of the sheet."""
    rest, now = np.asarray(equilibrium.mesh.vertices), np.asarray(equilibrium.vertices)
    ends = (now[np.isclose(rest[:, 0], x)].mean(0) for x in (0.0, 1.0))
    chord = np.linalg.norm(np.subtract(*ends))
    low, high = 1e-3, np.pi  # half the turn, of which the chord is a falling function
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.sin(middle) / middle > chord else (low, middle)
    return float(low + high)


def measure(level: int) -> Iterator[Figure]:
    """All of it on all kinds of meshes; averaged normals to compare where they matter."""
    stiffness = THICKNESS**3 / 12 / (1 - POISSON**2)
    flat = 0.5 * stiffness * (2 * np.pi) ** 2 * WIDTH
    for kind in KINDS:
        for directors, form in BENDING:
            label = f"{directors}, {form}, {kind}"
            for cells in SIZES[level]:
                equilibrium, seconds = rolled(roll(kind, cells, directors, form))
                yield Figure("radius of the cylinder", label, cells, RADIUS, radius(equilibrium), seconds)
                yield Figure("gap between the ends", label, cells, 0.0, gap(equilibrium), seconds)
                if form == "sin":
                    left = float(equilibrium.energy) / flat
                    yield Figure("energy of the cylinder", label, cells, 0.0, left, seconds)
        for cells in SIZES[level][:-1]:
            equilibrium, seconds = rolled(wide(kind, cells), 4)
            label, exact = f"free, sin, {kind}", THICKNESS**3 * WIDE[1] ** 2 / 24
            yield Figure(
                "curvature of a wide sheet", label, cells, WIDE[0] + POISSON * WIDE[1], bend(equilibrium), seconds
            )
            yield Figure("energy of a wide sheet", label, cells, exact, float(equilibrium.energy), seconds)
            equilibrium, seconds = rolled(timoshenko(kind, cells), 1)
            exact = 1.5 * MISFIT / THICKNESS
            yield Figure("curvature of two layers", label, cells, exact, bend(equilibrium), seconds)
        (left, start), seconds = timed(lambda kind=kind: exact_layers(kind, SIZES[level][0]))
        yield Figure("energy of a saddle from its own layers", kind, 0, 0.0, left / start, seconds)
