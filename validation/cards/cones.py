"""Card 11: a flat nematic disc that becomes a cone."""

from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np

import shellkit as sk

from ..figures import Figure, timed


TITLE = "Nematic cones"
PROBLEM = (
    "A flat disc of radius 1, h = 0.02, E = 1, ν = 0.3, b_r = 0, with directors around its centre and λ = 0.9, or "
    "along its rays and λ = 1.1. Exact axisymmetric solution of the same energy. The flat start is a saddle. Each face "
    "has one director, so that neighbours disagree about the length of their common edge: that energy of stretching, "
    "spread over the whole disc, is what the energy has too much, and falls with the square of the edges. The tip, "
    "rounded over a distance of about h, has too little on edges longer than that."
)
THICKNESS = 0.02
# Half-angle at half the radius in degrees, height, energy.
EXACT = {"azimuthal": (54.096, 0.634464, 4.59148e-6), "radial": (55.732, 0.602383, 4.11639e-6)}
STRETCH = {"azimuthal": 0.9, "radial": 1.1}
EDGES = {
    1: (0.2, 0.12),
    2: (0.16, 0.1, 0.08),
    3: (0.07, 0.05, 0.035, 0.025, 0.016),
    4: (0.05, 0.035, 0.025, 0.016, 0.012),
}


def cone(kind: str, edge: float, form: str = "sin", directors: str = "free") -> sk.InverseProblem:
    """The disc, flat, with its directors around the centre or along the rays."""
    disc = sk.meshes.disc(radius=1.0, target_edge_length=edge)
    centres = disc.vertices[disc.faces].mean(1)
    field = centres if kind == "radial" else jnp.cross(jnp.array([0.0, 0.0, 1.0]), centres)
    return sk.InverseProblem(
        mesh=disc,
        thickness=THICKNESS,
        actuation=sk.Nematic(angle=sk.director_angles(disc, field), stretch=STRETCH[kind]),
        energy=sk.StVenantKirchhoff.from_young(1.0, 0.3)
        + sk.Bending.from_young(1.0, 0.3, form=form, directors=directors),
    )


def shape(equilibrium: sk.Equilibrium) -> tuple[float, float]:
    """Half-angle in degrees at half the radius, and height, of a cone that may lie anyhow."""
    vertices, mesh = np.asarray(equilibrium.vertices), equilibrium.mesh
    normals = np.asarray(sk.face_normals(equilibrium.vertices, mesh))
    areas = np.asarray(sk.face_areas(equilibrium.vertices, mesh))
    axis = areas @ normals
    axis /= np.linalg.norm(axis)
    radii = np.linalg.norm(np.asarray(mesh.vertices)[np.asarray(mesh.faces)].mean(1), axis=1)
    ring = np.abs(radii - 0.5) < 0.1
    sine = np.average(normals[ring] @ axis, weights=areas[ring])
    return float(np.degrees(np.arcsin(sine))), float(np.ptp(vertices @ axis))


def measure(level: int, kinds=tuple(EXACT)) -> Iterator[Figure]:
    """Both cones with free directors, and the azimuthal one with averaged normals."""
    for kind in kinds:
        for directors in ("free", "average") if kind == "azimuthal" else ("free",):
            for edge in EDGES[level]:
                problem = cone(kind, edge, directors=directors)
                equilibrium, seconds = timed(problem)
                if not (bool(equilibrium.converged) and bool(equilibrium.stable)):
                    raise RuntimeError(f"{kind} cone at {edge}: {sk.RESULTS[equilibrium.result]}")
                for name, exact, ours in zip(
                    ("half-angle", "height", "energy"),
                    EXACT[kind],
                    (*shape(equilibrium), float(equilibrium.energy)),
                    strict=True,
                ):
                    yield Figure(f"{name}, {kind}", directors, 1 / edge, exact, ours, seconds)
