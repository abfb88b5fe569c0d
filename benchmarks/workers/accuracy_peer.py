"""The peer's error against its seconds, on the square that would like to roll up; it knows nothing of shellkit."""

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from triangulax import elastic
from triangulax.mesh import HeMesh
from triangulax.triangular import TriMesh

from ..measure import profile
from ..scene import ROLL_ALPHA, ROLL_BETA, ROLL_THICKNESS, roll_curvature, rolled, shape_probes
from .peer import TOLERANCE


class _Roll(eqx.Module):
    mesh: HeMesh
    vertices: jax.Array
    metric: jax.Array
    curvature: jax.Array
    max_steps: int = eqx.field(static=True)

    def energy(self, vertices: jax.Array, _: None = None) -> jax.Array:
        stretching = elastic.get_st_venant_kirchhoff_energy(vertices, (self.mesh, self.metric, ROLL_ALPHA, ROLL_BETA))
        bending = elastic.get_svk_bending_energy(
            vertices, (self.mesh, self.metric, self.curvature, ROLL_ALPHA, ROLL_BETA)
        )
        return ROLL_THICKNESS / 4 * stretching + ROLL_THICKNESS**3 / 12 * bending

    def relax(self) -> tuple[jax.Array, jax.Array, jax.Array]:
        solution = optx.minimise(
            self.energy,
            optx.NonlinearCG(rtol=TOLERANCE, atol=TOLERANCE),
            self.vertices,
            max_steps=self.max_steps,
            throw=False,
        )
        return solution.value, solution.stats["num_steps"], solution.result == optx.RESULTS.successful


def measure(mesh: str, max_steps: int, runs: int) -> dict:
    """The relaxation from the flat square, in triangulax's own basis of each face."""
    file = TriMesh.read_obj(mesh, dim=3)
    half_edges = HeMesh.from_triangles(len(file.vertices), file.faces)
    vertices = jnp.asarray(file.vertices)
    faces = jnp.asarray(half_edges.faces)
    scene = _Roll(
        half_edges, vertices, elastic.get_metric(vertices, half_edges), roll_curvature(vertices, faces), max_steps
    )
    (shape, steps, converged), record = profile(lambda scene: scene.relax(), scene, runs=runs)
    return record | {
        "steps": int(steps),
        "converged": bool(converged),
        "energy": float(scene.energy(shape)),
        "force_norm": float(jnp.linalg.norm(jax.grad(scene.energy)(shape))),
        "shape_probes": shape_probes(shape),
        "exact_probes": shape_probes(rolled(vertices)),
    }
