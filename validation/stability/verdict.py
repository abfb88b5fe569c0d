"""Whether a relaxation told the truth: its end judged by a dense Hessian and its null space, without the solver."""

import re
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import shellkit as sk
from shellkit._energy import Unknowns

from .cases import Case


_STEP = 1e-6  # of an edge: how far an equilibrium may be from where the gradient vanishes
_NEGATIVE = 1e-8  # of the largest eigenvalue: what rounding can make of a zero


@dataclass(frozen=True)
class Verdict:
    """What came of one case."""

    label: str
    finite: bool
    converged: bool
    honest: bool  # converged only where it is a minimum, and with a reason where not
    reason: str
    steps: int
    energy: float
    distance: float  # of a Newton step from there, in edges


@eqx.filter_jit
def _derivatives(problem: sk.InverseProblem, vertices: Array, directors: Array | None) -> tuple[Array, Array]:
    energy = problem.discrete_energy()
    unknowns = problem.assembly.dofs.gather(Unknowns(vertices, directors))
    return energy.gradient(unknowns), energy.hessian(unknowns).as_matrix()


def judge(case: Case) -> Verdict:
    """Relax a case, and look at where it ended."""
    problem = case.problem
    equilibrium = problem(case.start)
    finite = bool(jnp.isfinite(equilibrium.vertices).all() & jnp.isfinite(equilibrium.energy))
    converged, reason = bool(equilibrium.converged), str(sk.RESULTS[equilibrium.result])
    distance, minimum = np.inf, False
    if finite:
        distance, minimum = _at(problem, equilibrium)
    honest = (distance < _STEP and minimum) if converged else bool(reason)
    return Verdict(
        case.label,
        finite,
        converged,
        honest,
        "" if converged else re.split(r"[:;]|\. ", reason)[0].rstrip("."),
        int(equilibrium.steps),
        float(equilibrium.energy),
        float(distance),
    )


def _free_motions(problem: sk.InverseProblem, equilibrium: sk.Equilibrium) -> int:
    motions = problem.rigid_modes()
    if motions is None:
        return 0
    return int(np.count_nonzero(np.any(motions(problem.assembly.dofs.gather(equilibrium.unknowns)), axis=0)))


def _at(problem: sk.InverseProblem, equilibrium: sk.Equilibrium) -> tuple[float, bool]:
    """The length of a Newton step from there in edges, and whether no direction leads down.

    Unknowns are scaled so that their diagonals are one, which tells small stiffness from none; the
    flattest directions are the rigid motions, as many as are free.
    """
    gradient, hessian = (np.asarray(a) for a in _derivatives(problem, equilibrium.vertices, equilibrium.directors))
    size = 1 / np.sqrt(np.maximum(np.abs(np.diag(hessian)), 1e-300))
    values, vectors = np.linalg.eigh(hessian * size[:, None] * size[None, :])
    rigid = _free_motions(problem, equilibrium)
    stiff = np.argsort(np.abs(values))[rigid:]
    step = size * (vectors[:, stiff] @ ((vectors[:, stiff].T @ (size * gradient)) / values[stiff]))
    ends = np.asarray(problem.mesh.vertices)[np.asarray(problem.mesh.edges)]
    edge = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).mean()
    moves = np.abs(step).max() / edge
    return float(moves), bool(values.min() > -_NEGATIVE * values.max())
