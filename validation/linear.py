"""Small displacements: the stiffness matrix of a scene at a given shape, and the displacement under its loads."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import shellkit as sk
from shellkit._energy import Unknowns


def stiffness(problem: sk.InverseProblem, vertices: Float[Array, "V 3"] | None = None):
    """The Hessian in the free unknowns as a SciPy matrix, and the gradient, with the directors of the mesh at rest."""
    from scipy.sparse import csc_array, diags_array

    gradient, hessian = _derivatives(problem, problem.mesh.vertices if vertices is None else vertices)
    rows, columns = np.asarray(hessian.pattern.rows), np.asarray(hessian.pattern.indices)
    upper = csc_array((np.asarray(hessian.values), (rows, columns)), shape=(len(gradient),) * 2)
    return csc_array(upper + upper.T - diags_array(upper.diagonal())), np.asarray(gradient)


@eqx.filter_jit
def _derivatives(problem: sk.InverseProblem, vertices: Array):
    energy = problem.discrete_energy()
    unknowns = problem.assembly.dofs.gather(Unknowns(vertices))
    return energy.gradient(unknowns), energy.hessian(unknowns)


def solve(matrix, load: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Solve with a symmetric matrix, with one step of refinement, since thin shells are ill-conditioned."""
    factor = factorised(matrix)
    found = factor.solve(load)
    return found + factor.solve(load - matrix @ found)


def factorised(matrix):
    """A factor of a symmetric positive definite matrix."""
    from scipy.sparse.linalg import splu

    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def displacement(problem: sk.InverseProblem) -> Float[np.ndarray, "V 3"]:
    """How far the loads move each vertex, to first order."""
    matrix, gradient = stiffness(problem)
    move = jnp.asarray(solve(matrix, -gradient))
    return np.asarray(problem.assembly.dofs.motion(move).vertices)
