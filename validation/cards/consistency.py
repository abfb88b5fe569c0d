"""Card 4: the bending energy of smooth surfaces from exact vertices, against quadrature."""

from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np

import shellkit as sk

from ..figures import Figure, timed
from ..meshes import KINDS, Kind, curved, sheet
from ..surfaces import boundary_directors, forms_of, minimised, normals_on_edges


TITLE = "Curvature of smooth surfaces"
PROBLEM = (
    "Vertices exactly on a cylinder of 45° and on z = x² − y² + xy/2, with b_r = 0; directors minimised, those on the "
    "boundary exact. The bending energy against quadrature: E = 1, ν = 0.3."
)
THICKNESS, YOUNG, POISSON = 0.01, 1.0, 0.3
FORMS = ("sin", "tan", "theta")
SIZES = {1: (8, 16), 2: (8, 16, 32), 3: (16, 32, 64), 4: (16, 32, 64, 128)}


def cylinder(p):
    """A unit square rolled onto 45 degrees of a cylinder."""
    angle = np.pi / 4 * p[:, 0]
    return np.stack([4 / np.pi * np.sin(angle), p[:, 1], 4 / np.pi * np.cos(angle)], axis=1)


def saddle(p):
    """A graph over the unit square around the origin."""
    x, y = (p - 0.5).T
    return np.stack([x, y, x**2 - y**2 + 0.5 * x * y], axis=1)


def quadrature(chart) -> float:
    """h³/12 times the integral of alpha tr(K)² + 2 beta tr(K²), by Gauss's rule of 40 x 40 points."""
    points, weights = np.polynomial.legendre.leggauss(40)
    points, weights = 0.5 * (points + 1), 0.5 * weights
    parameters = np.stack([grid.ravel() for grid in np.meshgrid(points, points, indexing="ij")], axis=1)
    _, metric, curvature = forms_of(chart, parameters)
    k = np.linalg.solve(metric, curvature)
    alpha, beta = YOUNG * POISSON / (2 * (1 - POISSON**2)), YOUNG / (4 * (1 + POISSON))
    density = alpha * np.trace(k, axis1=1, axis2=2) ** 2 + 2 * beta * np.trace(k @ k, axis1=1, axis2=2)
    return float(THICKNESS**3 / 12 * np.outer(weights, weights).ravel() @ (density * np.sqrt(np.linalg.det(metric))))


SURFACES = {"cylinder": cylinder, "saddle": saddle}


def energy(surface: str, kind: Kind, cells: int, form: str, directors: str = "free") -> tuple[float, float]:
    """The bending energy of a surface and the seconds that it took."""
    chart = SURFACES[surface]
    flat = sheet(kind, (cells, cells))
    mesh = curved(flat, chart)
    problem = sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        actuation=sk.Prescribed(curvature=jnp.zeros((mesh.n_faces, 2, 2))),
        energy=sk.Bending.from_young(YOUNG, POISSON, form=form, directors=directors),
    )
    if directors == "average":
        value, seconds = timed(lambda: problem.total_energy(mesh.vertices))
        return float(value), seconds
    start = boundary_directors(mesh, normals_on_edges(chart, flat))
    held = np.asarray(mesh.boundary_edges)
    (value, _), seconds = timed(lambda: minimised(problem, start, held))
    return value, seconds


def measure(level: int, forms=FORMS) -> Iterator[Figure]:
    """Both surfaces on all kinds of meshes; averaged normals once, to compare."""
    for surface, chart in SURFACES.items():
        exact = quadrature(chart)
        for kind in KINDS:
            for cells in SIZES[level]:
                for form in forms:
                    value, seconds = energy(surface, kind, cells, form)
                    yield Figure(f"{surface}, free directors", f"{form}, {kind}", cells, exact, value, seconds)
            for cells in SIZES[level] if level > 1 else ():
                value, seconds = energy(surface, kind, cells, "sin", "average")
                yield Figure(f"{surface}, averaged normals", f"sin, {kind}", cells, exact, value, seconds)
