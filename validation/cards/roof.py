"""Card 13: shallow hinged roofs under a force at their middle, through snap-through and snap-back."""

from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np

import shellkit as sk

from ..figures import Figure, timed
from ..meshes import KINDS, Kind, curved, sheet


TITLE = "Hinged roofs"
PROBLEM = (
    "K. Y. Sze, X. H. Liu and S. H. Lo, Finite Elem. Anal. Des. 40 (2004), 1551. A part of a cylinder, R = 2540, L = "
    "508, half-angle 0.1, E = 3102.75, ν = 0.3 (in mm and N), its straight edges hinged and the curved ones free, "
    "pressed down at its middle; a quarter, followed by arc length. Thickness 12.7: the limit load over 3000 N, and "
    "how far the middle is down there. Thickness 6.35: the load turns round twice, and so does the middle, which moves "
    "back up while the load falls (snap-back); and, at the end of the path, the elastic energy against the work of the "
    "force along it."
)
RADIUS, LENGTH, HALF_ANGLE, YOUNG, POISSON, FORCE = 2540.0, 508.0, 0.1, 3102.75, 0.3, 3000.0
THICK, THIN = 12.7, 6.35
LIMIT, DOWN = 0.7421, 11.29
SIZES = {1: (4,), 2: (4, 8), 3: (4, 8), 4: (4, 8, 12)}


def roof(kind: Kind, cells: int, thickness: float) -> sk.InverseProblem:
    """A quarter, between the planes x = 0 and y = 0. The force lies in both, and a quarter of it is carried here."""
    flat = sheet(kind, (cells, cells), HALF_ANGLE, LENGTH / 2)
    angle, along, _ = flat.vertices.T

    def chart(p):
        return np.stack([RADIUS * np.sin(p[:, 0]), p[:, 1], RADIUS * (np.cos(p[:, 0]) - np.cos(HALF_ANGLE))], axis=1)

    ridge, middle = jnp.isclose(angle, 0.0), jnp.isclose(along, 0.0)
    return sk.InverseProblem(
        mesh=curved(flat, chart),
        thickness=thickness,
        energy=sk.StVenantKirchhoff.from_young(YOUNG, POISSON)
        + sk.Bending.from_young(YOUNG, POISSON, directors="free")
        + sk.PointLoad(jnp.flatnonzero(ridge & middle), [0.0, 0.0, -FORCE / 4]),
        supports=sk.Pinned(jnp.isclose(angle, HALF_ANGLE))
        + sk.Symmetry(ridge, normal="x")
        # The hinge holds the corner already, in the plane too.
        + sk.Symmetry(middle, normal="y"),
    )


def path(problem: sk.InverseProblem) -> sk.Branch:
    """The equilibria up to the whole of the force."""
    branch = sk.continue_path(problem, sk.ArcLength(first=0.1, steps=120))
    if not branch.complete:
        raise RuntimeError(f"{problem.mesh.n_vertices} vertices: the path ended early\n{branch}")
    return branch


def down(problem: sk.InverseProblem, vertices: jnp.ndarray) -> np.ndarray:
    """How far the middle is below where it was at rest, of one shape or several."""
    top = int(np.argmin(np.abs(np.asarray(problem.mesh.vertices)[:, :2]).sum(1)))
    return np.asarray(problem.mesh.vertices[top, 2] - vertices[..., top, 2])


def limits(branch: sk.Branch) -> list[sk.CriticalPoint]:
    """The points where the load turns round."""
    return [point for point in branch.critical if point.kind == "limit point"]


def turns(way: np.ndarray) -> int:
    """How often a sequence turns round."""
    return int(np.count_nonzero(np.diff(np.sign(np.diff(way)))))


def imbalance(problem: sk.InverseProblem, branch: sk.Branch) -> float:
    """The elastic energy at the end of a path less the work done on the way, over that energy."""
    way, load = down(problem, branch.vertices), FORCE / 4 * np.asarray(branch.progress)
    work = np.trapezoid(load, way)
    elastic = float(branch.energies[-1]) + load[-1] * way[-1]
    return (elastic - work) / elastic


def measure(level: int, kinds=KINDS) -> Iterator[Figure]:
    """Both roofs on all kinds of meshes; `cells` are those of the whole roof."""
    for kind in kinds:
        for cells in SIZES[level]:
            thick, thin = (roof(kind, cells, thickness) for thickness in (THICK, THIN))
            branch, seconds = timed(lambda thick=thick: path(thick))
            first = limits(branch)[0]
            way = float(down(thick, first.equilibrium.vertices))
            yield Figure("12.7 mm, limit load", f"free, {kind}", 2 * cells, LIMIT, float(first.progress), seconds)
            yield Figure("12.7 mm, down at the limit", f"free, {kind}", 2 * cells, DOWN, way, seconds)
            branch, seconds = timed(lambda thin=thin: path(thin))
            found = (len(limits(branch)), turns(down(thin, branch.vertices)))
            for name, count in zip(("the load", "the middle"), found, strict=True):
                yield Figure(f"6.35 mm, turns of {name}", f"free, {kind}", 2 * cells, 2.0, float(count), seconds)
            yield Figure("6.35 mm, energy less work", f"free, {kind}", 2 * cells, 0.0, imbalance(thin, branch), seconds)
