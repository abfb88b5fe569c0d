"""What a relaxation, and each part of it, costs on a mesh of some size."""

import jax.numpy as jnp
import numpy as np

import shellkit as sk
from shellkit._energy import Assembly

from ..measure import Stage, profile
from .problems import teacher


def measure(subdivisions: int, what: str, runs: int) -> dict:
    """The tutorial's teacher on an icosphere: its `"parts"` one by one, or the whole `"relaxation"`; in two processes,
    so that each has its own memory."""
    mesh = sk.meshes.icosphere(subdivisions)
    with Stage() as construction:
        problem = teacher(mesh)
    figures = _parts(problem, runs) if what == "parts" else _relaxation(problem, runs)
    return figures | {
        "n_vertices": mesh.n_vertices,
        "n_faces": mesh.n_faces,
        "nonzeros": problem.assembly.pattern.nnz,
        "problem_mb": construction.megabytes,
    }


def _parts(problem: sk.InverseProblem, runs: int) -> dict:
    mesh, y = problem.mesh, problem.mesh.vertices.reshape(-1)
    with Stage() as connectivity:
        sk.Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    with Stage() as numbering:
        Assembly.of(problem.energy, mesh)
    hessian, assembly = profile(lambda problem, y: problem.discrete_energy().hessian(y), problem, y, runs=runs)
    # A small shift takes the place of what Newton does about the rigid motions.
    solver = sk.SparseNewton().linear_solver
    factor, factorisation = profile(solver.factorise, hessian.shifted(1e-6), runs=runs)
    _, solve = profile(solver.solve, factor, jnp.sin(jnp.arange(y.size)), runs=runs)
    return {
        "solver": type(solver).__name__,
        "connectivity_s": connectivity.seconds,
        "numbering_s": numbering.seconds,
        "assembly": assembly,
        "factorisation": factorisation,
        "solve": solve,
    }


def _relaxation(problem: sk.InverseProblem, runs: int) -> dict:
    equilibrium, relaxation = profile(lambda problem: problem(), problem, runs=runs)
    return relaxation | {
        "steps": int(equilibrium.steps),
        "factorisations": int(equilibrium.factorisations),
        "converged": bool(equilibrium.converged),
        "force_norm": float(equilibrium.gradient_norm),
    }
