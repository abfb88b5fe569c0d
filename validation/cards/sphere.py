"""Card 2: a sphere that swells, by its metric and by its curvature; and how it answers to a change of either."""

from collections.abc import Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import shellkit as sk

from ..figures import Figure, timed
from ..meshes import KINDS, Kind, sphere


TITLE = "Swollen sphere"
PROBLEM = (
    "The unit sphere with g_r = λ² g₀ and b_r = c b₀, λ = 1.1, c = 1, h = 0.2, α = β = 1: its radius ρ solves "
    "ρ³ + (η − λ²)ρ − ηc = 0 with η = h²/6."
)
THICKNESS, STRETCH = 0.2, 1.1
RADIUS, ENERGY, BY_STRETCH, BY_CURVATURE = 1.0997251720, 5.5236756e-4, 0.9977492863, 0.0027493075
SIZES = {1: (4, 8), 2: (4, 8, 16), 3: (8, 16, 32), 4: (8, 16, 32)}


class Swelling(eqx.Module):
    """The radius, the energy and both sensitivities of a sphere."""

    radius: jax.Array
    energy: jax.Array
    by_stretch: jax.Array
    by_curvature: jax.Array
    converged: jax.Array


def curvature_of(mesh: sk.Mesh) -> jax.Array:
    """The curvature form of the unit sphere on the plane of each face, from the exact normals at its corners."""
    corners = mesh.vertices[mesh.faces]
    normals = corners / jnp.linalg.norm(corners, axis=-1, keepdims=True)
    edges, turns = corners[:, 1:] - corners[:, :1], normals[:, 1:] - normals[:, :1]
    form = jnp.einsum("fia,fja->fij", edges, turns)
    return 0.5 * (form + jnp.swapaxes(form, 1, 2))


@eqx.filter_jit
def _swell(problem: sk.InverseProblem) -> Swelling:
    def radius(stretch, curvature):
        metric = stretch**2 * sk.first_form(problem.mesh.vertices, problem.mesh)
        rest = sk.Prescribed(metric, curvature * curvature_of(problem.mesh))
        equilibrium = eqx.tree_at(lambda p: p.actuation, problem, rest, is_leaf=lambda x: x is problem.actuation)()
        return jnp.mean(jnp.linalg.norm(equilibrium.vertices, axis=1)), equilibrium

    value, push, equilibrium = jax.linearize(radius, jnp.asarray(STRETCH), jnp.asarray(1.0), has_aux=True)
    one, zero = jnp.ones(()), jnp.zeros(())
    return Swelling(value, equilibrium.energy, push(one, zero), push(zero, one), equilibrium.converged)


def swell(kind: Kind, cells: int, directors: str) -> tuple[Swelling, float]:
    """The swollen sphere on one mesh, and the seconds that it took."""
    mesh = sphere(kind, cells)
    problem = sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        actuation=sk.Prescribed(sk.first_form(mesh.vertices, mesh), curvature_of(mesh)),
        energy=sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0, directors=directors),
    )
    return timed(lambda: _swell(problem))


def compatible(kind: Kind, cells: int, directors: str) -> float:
    """How far a sphere is from the radius λ when both its forms grow with it, at vertices: zero on any mesh."""
    mesh = sphere(kind, cells)
    problem = sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        actuation=sk.Prescribed(
            STRETCH**2 * sk.first_form(mesh.vertices, mesh), STRETCH * sk.second_form(mesh.vertices, mesh)
        ),
        energy=sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0, directors=directors),
    )
    # The pose is that nearest to the start: the mean of the vertices stays, where that of a swollen sphere moves out.
    vertices = np.asarray(problem().vertices + (STRETCH - 1) * jnp.mean(mesh.vertices, axis=0))
    return float(np.abs(np.linalg.norm(vertices, axis=1) - STRETCH).max())


def measure(level: int) -> Iterator[Figure]:
    """Free directors on all kinds of meshes, averaged normals to compare."""
    for kind in KINDS:
        for directors in ("free", "average"):
            label = f"{directors}, {kind}"
            for cells in SIZES[level]:
                found, seconds = swell(kind, cells, directors)
                size = 4 * cells / (2 * np.pi)
                yield Figure("radius", label, size, RADIUS, float(found.radius), seconds)
                yield Figure("energy", label, size, ENERGY, float(found.energy), seconds)
                yield Figure("dρ/dλ", label, size, BY_STRETCH, float(found.by_stretch), seconds)
                yield Figure("dρ/dc", label, size, BY_CURVATURE, float(found.by_curvature), seconds)
            value, seconds = timed(lambda kind=kind, directors=directors: compatible(kind, SIZES[level][0], directors))
            yield Figure("largest |r − λ| for c = λ", label, 0, 0.0, value, seconds)
