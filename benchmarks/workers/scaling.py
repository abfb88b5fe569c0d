"""What each part of a relaxation costs on a mesh of some size."""

import jax.numpy as jnp
import numpy as np

import shellkit as sk
from shellkit._energy import Assembly

from ..measure import Stage, peak_memory, profile, resident
from .problems import teacher


def measure(subdivisions: int, runs: int) -> dict:
    """Mesh and assembly on the host; Hessian, factorisation, solve; and a whole relaxation, of the tutorial's teacher."""
    before = resident()
    mesh = sk.meshes.icosphere(subdivisions)
    with Stage() as connectivity:
        sk.Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    problem = teacher(mesh)
    with Stage() as numbering:
        Assembly.of(problem.energy, mesh)

    y = mesh.vertices.reshape(-1)
    hessian, assembly = profile(lambda problem, y: problem.discrete_energy().hessian(y), problem, y, runs=runs)
    # A small shift takes the place of what Newton does about the rigid motions.
    regular = hessian.shifted(1e-6)
    solver = sk.SparseNewton().linear_solver
    factor, factorisation = profile(solver.factorise, regular, runs=runs)
    _, solve = profile(solver.solve, factor, jnp.sin(jnp.arange(len(y))), runs=runs)
    equilibrium, relaxation = profile(lambda problem: problem(), problem, runs=max(1, runs // 2))
    return {
        "memory_mb": peak_memory() - before,
        "n_vertices": mesh.n_vertices,
        "n_faces": mesh.n_faces,
        "nonzeros": hessian.pattern.nnz,
        "solver": type(solver).__name__,
        "connectivity_s": connectivity.seconds,
        "numbering_s": numbering.seconds,
        "numbering_mb": numbering.megabytes,
        "assembly": assembly,
        "factorisation": factorisation,
        "solve": solve,
        "relaxation": relaxation,
        "steps": int(equilibrium.steps),
        "factorisations": int(equilibrium.factorisations),
        "converged": bool(equilibrium.converged),
        "force_norm": float(equilibrium.gradient_norm),
    }
