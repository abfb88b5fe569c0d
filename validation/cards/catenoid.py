"""Card 5: a catenoid bent without stretching, half way to its helicoid."""

from collections.abc import Iterator

import numpy as np

import shellkit as sk

from ..figures import Figure, timed
from ..meshes import KINDS, Kind, curved, sheet
from ..surfaces import boundary_directors, curvature_on_faces, minimised, normals_on_edges


TITLE = "Catenoid to helicoid"
PROBLEM = (
    "The catenoid |v| ≤ 1, 0 < u < π, bent isometrically by 45° of its associate family, with the catenoid's own forms "
    "at rest. E_b = ½(8π/3) β h³ tanh 1 (1 − cos 45°); the stretching energy, zero on the surface, falls with Δ⁴."
)
THICKNESS, BETA, ALPHA, ANGLE = 0.02, 1.0, 0.6, np.pi / 4
EXACT = 0.5 * 8 * np.pi / 3 * BETA * THICKNESS**3 * np.tanh(1.0) * (1 - np.cos(ANGLE))
SIZES = {1: (8, 16), 2: (8, 16, 32), 3: (16, 32, 64), 4: (16, 32, 64)}


def chart(angle: float):
    """The member of the associate family at an angle, over the unit square."""

    def positions(p):
        u, v = np.pi * p[:, 0], 2 * p[:, 1] - 1
        catenoid = np.stack([np.sinh(v) * np.sin(u), -np.sinh(v) * np.cos(u), u], axis=1)
        helicoid = np.stack([np.cosh(v) * np.cos(u), np.cosh(v) * np.sin(u), v], axis=1)
        return np.cos(angle) * catenoid + np.sin(angle) * helicoid

    return positions


def energies(kind: Kind, cells: int, form: str) -> tuple[float, float, float]:
    """Bending and stretching energy at the exact vertices, and the seconds that the directors took."""
    flat = sheet(kind, (cells, cells))
    catenoid, bent = curved(flat, chart(0.0)), curved(flat, chart(ANGLE))
    rest = sk.Prescribed(sk.first_form(catenoid.vertices, catenoid), curvature_on_faces(chart(0.0), flat))
    scene = lambda energy: sk.InverseProblem(mesh=bent, thickness=THICKNESS, actuation=rest, energy=energy)
    bending = scene(sk.Bending(ALPHA, BETA, form=form, directors="free"))
    start = boundary_directors(bent, normals_on_edges(chart(ANGLE), flat))
    held = np.asarray(bent.boundary_edges)
    (value, _), seconds = timed(lambda: minimised(bending, start, held))
    stretching = scene(sk.StVenantKirchhoff(ALPHA, BETA)).total_energy(bent.vertices)
    return value, float(stretching), seconds


def measure(level: int, forms=("sin", "tan")) -> Iterator[Figure]:
    """All kinds of meshes; the stretching energy in units of the bending energy."""
    for kind in KINDS:
        for form in forms:
            for cells in SIZES[level]:
                bending, stretching, seconds = energies(kind, cells, form)
                yield Figure("bending energy", f"{form}, {kind}", cells, EXACT, bending, seconds)
                if form == forms[0]:
                    yield Figure("stretching energy over E_b", kind, cells, 0.0, stretching / EXACT, seconds)
