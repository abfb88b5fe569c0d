"""Card 6: the vibrations of a spherical shell, known in closed form."""

from collections.abc import Iterator

import numpy as np

import shellkit as sk

from ..figures import Figure, timed
from ..meshes import KINDS, sphere


TITLE = "Spectrum of a sphere"
PROBLEM = (
    "The eigenvalues of the Hessian at rest with the lumped mass of unit density, R = 1, E = 1, ν = 0.3: six rigid "
    "motions, then five modes of degree 2 and seven of degree 3."
)
EXACT = {0.1: (0.0550320713, 0.0836532478), 0.01: (0.00540011765, 0.00757736742)}
TORSION = 0.154358974  # of degree 2; where h = 0.1 it lies among bending modes
SIZES = {1: (4, 8), 2: (6, 8, 12, 16), 3: (8, 16, 32), 4: (8, 16, 32, 48)}
_ENOUGH = 48  # modes up to the torsion


def modes(mesh: sk.Mesh, thickness: float, directors: str, form: str = "sin", count: int = 18):
    """The lowest modes, and the seconds that they took."""
    problem = sk.InverseProblem(
        mesh=mesh,
        thickness=thickness,
        energy=sk.StVenantKirchhoff.from_young(1.0, 0.3)
        + sk.Bending.from_young(1.0, 0.3, form=form, directors=directors),
    )
    return timed(lambda: sk.vibration_modes(problem, count=count))


def torsion(mesh: sk.Mesh, found: sk.Modes) -> np.ndarray:
    """The eigenvalues of the modes that hardly move along the normal."""
    shapes = np.asarray(found.modes)
    normals = np.asarray(mesh.vertices)
    radial = np.linalg.norm((shapes * normals).sum(-1), axis=1) / np.linalg.norm(shapes, axis=(1, 2))
    values = np.asarray(found.eigenvalues)
    return values[(radial < 0.2) & (values > 1e-6)][:5]


def measure(level: int) -> Iterator[Figure]:
    """Free directors on all kinds of meshes, averaged normals to compare; and icospheres, which hide the difference."""
    for kind in KINDS:
        for directors in ("free", "average"):
            for cells in SIZES[level]:
                for thickness, exact in EXACT.items():
                    yield from _figures(sphere(kind, cells), cells, kind, directors, thickness, exact)
    for subdivisions in range(2, 3 + min(level, 3)):
        yield from _figures(sk.meshes.icosphere(subdivisions), 2**subdivisions, "icosphere", "free", 0.1, EXACT[0.1])


def _figures(mesh, cells, kind, directors, thickness, exact) -> Iterator[Figure]:
    with_torsion = thickness == 0.1 and directors == "free"
    found, seconds = modes(mesh, thickness, directors, count=_ENOUGH if with_torsion else 18)
    values, label, size = np.asarray(found.eigenvalues), f"{directors}, {kind}", 4 * cells / (2 * np.pi)
    for degree, value, group in ((2, exact[0], values[6:11]), (3, exact[1], values[11:18])):
        # The one of the group that is furthest off.
        worst = float(group[np.argmax(np.abs(group - value))])
        yield Figure(f"degree {degree}, h = {thickness}", label, size, value, worst, seconds)
    if with_torsion:
        group = torsion(mesh, found)
        if len(group) == 5:
            worst = float(group[np.argmax(np.abs(group - TORSION))])
            yield Figure(f"torsion, h = {thickness}", label, size, TORSION, worst, seconds)
        yield Figure("largest eigenvalue of a rigid motion", label, 0, 0.0, float(np.abs(values[:6]).max()), seconds)
