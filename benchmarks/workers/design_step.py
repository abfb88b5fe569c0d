"""shellkit's design step: the loss of the relaxed shell and its gradient in the director angles."""

import equinox as eqx
import jax
import jax.numpy as jnp

import shellkit as sk

from ..measure import profile
from ..scene import gradient_probes, shape_probes
from .problems import design_problem, director_angles


def _forward(problem: sk.InverseProblem) -> jax.Array:
    return problem().vertices


def _design_step(problem: sk.InverseProblem):
    def loss(angles):
        value, (_, equilibrium) = eqx.tree_at(director_angles, problem, angles).objective()
        return value, equilibrium

    return jax.value_and_grad(loss, has_aux=True)(director_angles(problem))


def measure(mesh: str, loss: str, stretch: float, field: str, form: str, runs: int) -> dict:
    """The design step on the mesh in a file, and the relaxation alone."""
    problem = design_problem(sk.Mesh.read(mesh), loss, stretch, field, form)
    ((value, equilibrium), gradient), record = profile(_design_step, problem, runs=runs)
    force = jax.grad(problem.total_energy)(equilibrium.vertices)
    return record | {
        "steps": int(equilibrium.steps),
        "factorisations": int(equilibrium.factorisations),
        "converged": bool(equilibrium.converged),
        "result": sk.RESULTS[equilibrium.result],
        "energy": float(equilibrium.energy),
        "force_norm": float(jnp.linalg.norm(force)),
        "force_max": float(jnp.max(jnp.abs(force))),
        "value": float(value),
        "shape_probes": shape_probes(equilibrium.vertices),
        "gradient_probes": gradient_probes(gradient),
        "forward": profile(_forward, problem, runs=runs)[1],
    }
