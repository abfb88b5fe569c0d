"""shellkit's error against its seconds: of a mesh, of a minimiser's tolerance, of a gradient."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx

import shellkit as sk

from ..measure import profile
from ..scene import (
    ROLL_ALPHA,
    ROLL_BETA,
    ROLL_THICKNESS,
    gradient_probes,
    roll_curvature,
    rolled,
    shape_probes,
)
from .problems import design_problem, director_angles


_MINIMISERS = {
    "SparseNewton": lambda tolerance: sk.SparseNewton(rtol=tolerance),
    "NonlinearCG": lambda tolerance: optx.NonlinearCG(rtol=tolerance, atol=tolerance),
    "LBFGS": lambda tolerance: optx.LBFGS(rtol=tolerance, atol=tolerance),
}
_MAX_STEPS, _ROLL_STEPS = 20_000, 100_000


def roll(mesh: sk.Mesh, form: str, directors: str, minimiser: str = "SparseNewton") -> sk.InverseProblem:
    """The square that would like to roll up."""
    return sk.InverseProblem(
        mesh=mesh,
        thickness=ROLL_THICKNESS,
        actuation=sk.Prescribed(curvature=roll_curvature(mesh.vertices, mesh.faces)),
        energy=sk.StVenantKirchhoff(ROLL_ALPHA, ROLL_BETA)
        + sk.Bending(ROLL_ALPHA, ROLL_BETA, form=form, directors=directors),
        solver=_MINIMISERS[minimiser](1e-11 if minimiser == "SparseNewton" else 1e-9),
        max_steps=None if minimiser == "SparseNewton" else _ROLL_STEPS,
    )


def measure(what: str, mesh: str, runs: int, **arguments) -> dict:
    """One point of a figure: `"mesh"`, `"solver"` or `"gradient"`."""
    return _PARTS[what](sk.Mesh.read(mesh), runs, **arguments)


def _of_mesh(mesh: sk.Mesh, runs: int, form: str, directors: str, minimiser: str) -> dict:
    equilibrium, record = profile(_relaxed, roll(mesh, form, directors, minimiser), runs=runs)
    return record | _state(equilibrium) | {"exact_probes": shape_probes(rolled(mesh.vertices))}


def _of_solver(mesh: sk.Mesh, runs: int, minimiser: str, tolerance: float) -> dict:
    equilibrium, record = profile(_relaxed, _design(mesh, minimiser, tolerance), runs=runs)
    return record | _state(equilibrium)


def _of_gradient(mesh: sk.Mesh, runs: int, method: str, parameter: float) -> dict:
    """`parameter` is the tolerance of the relaxation, the step of the differences, or the steps that are unrolled."""
    problem = _design(mesh, "SparseNewton", parameter if method == "implicit" else 1e-11)
    gradient, record = profile(partial(_GRADIENTS[method], parameter), problem, runs=runs)
    return record | {"gradient_probes": gradient_probes(gradient)}


_PARTS = {"mesh": _of_mesh, "solver": _of_solver, "gradient": _of_gradient}


def _design(mesh: sk.Mesh, minimiser: str, tolerance: float) -> sk.InverseProblem:
    """The ellipsoid problem at random directors, relaxed in one way or another."""
    problem = design_problem(mesh, "ellipsoid", 1.1, "random")
    return sk.InverseProblem(
        mesh=problem.mesh,
        thickness=problem.thickness,
        energy=problem.energy,
        actuation=problem.actuation,
        loss=problem.loss,
        solver=_MINIMISERS[minimiser](tolerance),
        max_steps=None if minimiser == "SparseNewton" else _MAX_STEPS,
    )


def _relaxed(problem: sk.InverseProblem) -> sk.Equilibrium:
    return problem()


def _state(equilibrium: sk.Equilibrium) -> dict:
    return {
        "steps": int(equilibrium.steps),
        "converged": bool(equilibrium.converged),
        "energy": float(equilibrium.energy),
        "force_norm": float(equilibrium.gradient_norm),
        "shape_probes": shape_probes(equilibrium.vertices),
    }


def _implicit(_, problem: sk.InverseProblem):
    loss = lambda angles: eqx.tree_at(director_angles, problem, angles).evaluate()[0]
    return jax.grad(loss)(director_angles(problem))


def _differences(step: float, problem: sk.InverseProblem):
    """Central differences in every angle, one after another."""
    angles = director_angles(problem)
    flat = jnp.concatenate(angles)

    def loss(values):
        return eqx.tree_at(director_angles, problem, tuple(jnp.split(values, 2))).evaluate()[0]

    def slope(index):
        direction = jnp.zeros_like(flat).at[index].set(step)
        return (loss(flat + direction) - loss(flat - direction)) / (2 * step)

    return tuple(jnp.split(jax.lax.map(slope, jnp.arange(len(flat))), 2))


def _unrolled(steps: float, problem: sk.InverseProblem):
    """Through so many steps of conjugate gradients."""

    def loss(angles):
        changed = eqx.tree_at(director_angles, problem, angles)
        energy = lambda vertices, moved: moved.total_energy(vertices)
        found = optx.minimise(
            energy,
            optx.NonlinearCG(rtol=0.0, atol=0.0),
            problem.mesh.vertices,
            changed,
            max_steps=int(steps),
            adjoint=optx.RecursiveCheckpointAdjoint(),
            throw=False,
        )
        shape = eqx.tree_at(lambda e: e.vertices, changed.unrelaxed(), found.value)
        return problem.loss.evaluate(shape, changed.actuation)[0]

    return jax.grad(loss)(director_angles(problem))


_GRADIENTS = {"implicit": _implicit, "differences": _differences, "unrolled": _unrolled}
