"""The design problems of `benchmarks.tutorial`, in shellkit."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import shellkit as sk
from shellkit._energy import Unknowns

from .measure import repeat
from .tutorial import (
    FOLDS,
    ROLL_ALPHA,
    ROLL_BETA,
    ROLL_THICKNESS,
    SMOOTHNESS_OF,
    THICKNESS,
    ellipsoid,
    fields,
    roll_curvature,
)


def bilayer(top: jax.Array, bottom: jax.Array, stretch: float) -> sk.Bilayer:
    return sk.Bilayer(top=sk.Nematic(angle=top, stretch=stretch), bottom=sk.Nematic(angle=bottom, stretch=stretch))


def director_angles(problem: sk.InverseProblem) -> tuple[jax.Array, jax.Array]:
    """The arrays that a design step trains."""
    actuation: Any = problem.actuation
    return actuation.top.angle, actuation.bottom.angle


def design_problem(
    mesh: sk.Mesh, loss: str, stretch: float, field: str, form: Any = "sin", **relaxation: Any
) -> sk.InverseProblem:
    """The ellipsoid or the sphericity problem on a mesh, at the director field of that name."""
    heads = loss == "sphericity"
    stretching = sk.NeoHookean(bulk=1.0, shear=1.0) if heads else sk.StVenantKirchhoff(1.0, 1.0)
    wanted = sk.Sphericity() + FOLDS * sk.FoldPenalty() if heads else to_ellipsoid(mesh)
    return sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        energy=stretching + sk.Bending(1.0, 1.0, form=form),
        actuation=bilayer(*fields(field, mesh.n_faces), stretch),
        loss=wanted + SMOOTHNESS_OF[loss] * sk.DirectorSmoothness(),
        **relaxation,
    )


def to_ellipsoid(mesh: sk.Mesh, aligner: Any = None) -> sk.Loss:
    """The distance to the tutorial's ellipsoid."""
    return sk.VertexDistance(ellipsoid(mesh.vertices), aligner=sk.Kabsch() if aligner is None else aligner)


def teacher(mesh: sk.Mesh, loss: sk.Loss | None = None, **relaxation: Any) -> sk.InverseProblem:
    """The tutorial's teacher: directors along z on top and across below, stretch 1.1. The shell buckles."""
    along = sk.director_angles(mesh, jnp.array([0.0, 0.0, 1.0]))
    return sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        energy=sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0),
        actuation=bilayer(along, along + jnp.pi / 2, 1.1),
        loss=loss,
        **relaxation,
    )


def rolling(mesh: sk.Mesh, thickness: float = ROLL_THICKNESS, **others: Any) -> sk.InverseProblem:
    """The square that would like to roll up; of other directors or another form with `form` and `directors`."""
    bending = {name: others.pop(name) for name in ("form", "directors") if name in others}
    return sk.InverseProblem(
        mesh=mesh,
        thickness=thickness,
        actuation=sk.Prescribed(curvature=roll_curvature(mesh.vertices, mesh.faces)),
        energy=sk.StVenantKirchhoff(ROLL_ALPHA, ROLL_BETA) + sk.Bending(ROLL_ALPHA, ROLL_BETA, **bending),
        **others,
    )


def gradient_in(where: Callable[[sk.InverseProblem], Any]) -> Callable[[sk.InverseProblem], tuple[jax.Array, Any]]:
    """A function that gives the loss of a problem and its gradient in the chosen arrays, the relaxation included."""

    def value_and_gradient(problem: sk.InverseProblem) -> tuple[jax.Array, Any]:
        chosen, rest = eqx.partition(where(problem), eqx.is_inexact_array)
        loss = lambda chosen: eqx.tree_at(where, problem, eqx.combine(chosen, rest)).evaluate()[0]
        return eqx.filter_value_and_grad(loss)(chosen)

    return value_and_gradient


def relaxed(problem: sk.InverseProblem) -> sk.Equilibrium:
    """The relaxation, to be compiled as one program."""
    return problem()


def ending(equilibrium: sk.Equilibrium) -> dict[str, Any]:
    """Where a relaxation ended, and in how many steps."""
    return {
        "steps": int(equilibrium.steps),
        "factorisations": int(equilibrium.factorisations),
        "converged": bool(equilibrium.converged),
        "energy": float(equilibrium.energy),
        "force_norm": float(equilibrium.gradient_norm),
    }


def kernels(problem: sk.InverseProblem, functions: dict[str, Callable], runs: int) -> dict[str, Any]:
    """Functions of the energy and the unknowns, compiled and timed one by one at a deformed shape."""
    rest = problem.assembly.dofs.gather(Unknowns(problem.mesh.vertices))
    y = rest + 0.01 * np.random.default_rng(0).standard_normal(rest.shape)
    energy = problem.discrete_energy()
    return {"kernels": {name: repeat(jax.jit(function), energy, y, runs=runs) for name, function in functions.items()}}
