"""Kernels or a whole relaxation on the platform that JAX was started on."""

import equinox as eqx
import jax
import numpy as np

import shellkit as sk

from ..measure import profile, repeat
from .problems import teacher


def measure(subdivisions: int, solver: str | None, runs: int) -> dict:
    """The tutorial's teacher on an icosphere: relaxed with the sparse solver of that name; its kernels if `None`."""
    mesh = sk.meshes.icosphere(subdivisions)
    problem = teacher(mesh)
    figures = _kernels(problem, runs) if solver is None else _relaxation(problem, solver, runs)
    return figures | {"device": jax.devices()[0].device_kind, "n_vertices": mesh.n_vertices, "n_faces": mesh.n_faces}


def _kernels(problem: sk.InverseProblem, runs: int) -> dict:
    energy = problem.discrete_energy()
    rest = problem.assembly.restrict(problem.assembly.join(problem.mesh.vertices, None))
    y = rest + 0.01 * np.random.default_rng(0).standard_normal(rest.shape)
    kernels = {
        "gradient": jax.jit(lambda energy, y: energy.value_and_gradient(y)),
        "derivatives": jax.jit(lambda energy, y: energy.derivatives(y)[:3]),
    }
    return {"kernels": {name: repeat(kernel, energy, y, runs=runs) for name, kernel in kernels.items()}}


def _relaxation(problem: sk.InverseProblem, solver: str, runs: int) -> dict:
    method = sk.SparseNewton(linear_solver=sk.direct_solver(solver))
    problem = eqx.tree_at(lambda problem: problem.solver, problem, method)
    equilibrium, record = profile(lambda problem: problem(), problem, runs=runs)
    return record | {
        "steps": int(equilibrium.steps),
        "factorisations": int(equilibrium.factorisations),
        "converged": bool(equilibrium.converged),
        "force_norm": float(equilibrium.gradient_norm),
        "energy": float(equilibrium.energy),
    }
