"""What a gradient costs beside the relaxation that it goes through."""

import equinox as eqx

import shellkit as sk

from ..measure import profile
from .problems import design_problem, director_angles


def _angles(problem: sk.InverseProblem):
    return director_angles(problem)


def _physics(problem: sk.InverseProblem):
    return problem.actuation, problem.energy, problem.thickness


def _gradient_in(where):
    def value_and_gradient(problem: sk.InverseProblem):
        chosen, rest = eqx.partition(where(problem), eqx.is_inexact_array)
        loss = lambda chosen: eqx.tree_at(where, problem, eqx.combine(chosen, rest)).evaluate()[0]
        return eqx.filter_value_and_grad(loss)(chosen)

    return value_and_gradient


def measure(mesh: str, loss: str, stretch: float, form: str, runs: int) -> dict:
    """The loss; with its gradient in the director angles; and in all arrays of actuation, energy and thickness."""
    problem = design_problem(sk.Mesh.read(mesh), loss, stretch, "random", form)
    return {
        "n_vertices": problem.mesh.n_vertices,
        "forward": profile(lambda problem: problem.evaluate()[0], problem, runs=runs)[1],
        "angles": profile(_gradient_in(_angles), problem, runs=runs)[1],
        "physics": profile(_gradient_in(_physics), problem, runs=runs)[1],
    }
