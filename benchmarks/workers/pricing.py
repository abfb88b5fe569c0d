"""What a scene costs: the size of its matrix, its derivatives, its factorisation, its relaxation, its gradient."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax

import shellkit as sk
from shellkit._relaxation.augmented_lagrangian import Stationary, padded
from shellkit._solve.linear.bordered import BorderedSolver
from shellkit._solve.null_space import held_still

from ..measure import profile
from ..scene import ellipsoid
from .problems import bilayer


_THICKNESS, _GROWTH, _UNEVEN = 0.1, 1.1, 0.05


def build(name: str, mesh: sk.Mesh) -> sk.InverseProblem:
    """The scene of that name in `benchmarks.pricing`."""
    x, _, z = mesh.vertices.T
    stretching = sk.NeoHookean(1.0, 1.0) if name == "neo-Hookean" else sk.StVenantKirchhoff(1.0, 1.0)
    bending = sk.Bending(
        1.0, 1.0, form="tan" if name == "tan" else "sin", directors="free" if name == "free directors" else "average"
    )
    energy = stretching if name == "stretching" else stretching + bending
    if name == "pressure":
        energy = energy + sk.Pressure(0.01)
    if name == "volume":
        energy = energy + sk.Inflation(1.4)
    if name in ("gravity", "contact"):
        energy = energy + sk.Gravity(0.001)
    if name == "contact":
        energy = energy + sk.PlaneContact([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], stiffness=1.0, softness=0.02)
    supports = None
    if name in ("clamped", "gravity", "contact"):
        supports = sk.Clamped(z < -0.7)
    if name == "six held":
        # A point, a line through it and a plane: no growth that is even about the axis is hindered.
        top, bottom, side = (int(np.argmax(np.asarray(along))) for along in (z, -z, x))
        supports = sk.Pinned([bottom]) + sk.Sliding([top], along="z") + sk.Sliding([side], normal="y")
    height = mesh.vertices[mesh.faces].mean(axis=1)[:, 2]
    growth = sk.IsotropicGrowth(_GROWTH + _UNEVEN * height)
    angles = jnp.linspace(0.0, np.pi, mesh.n_faces)
    aligner = sk.NoAlignment() if name == "unaligned" else sk.Kabsch()
    return sk.InverseProblem(
        mesh=mesh,
        thickness=_THICKNESS,
        energy=energy,
        actuation=bilayer(angles, angles + 0.3, _GROWTH) if name == "bilayer" else growth,
        supports=supports,
        loss=sk.VertexDistance(ellipsoid(mesh.vertices), aligner=aligner),
    )


def trained(problem: sk.InverseProblem) -> Any:
    """The arrays in which the loss is differentiated."""
    actuation: Any = problem.actuation
    return (actuation.top.angle, actuation.bottom.angle) if isinstance(actuation, sk.Bilayer) else actuation.stretch


def _gradient(problem: sk.InverseProblem):
    loss = lambda arrays: eqx.tree_at(trained, problem, arrays).evaluate()[0]
    return jax.value_and_grad(loss)(trained(problem))


def measure(mesh: str, scene: str, runs: int) -> dict:
    """The parts of one scene; of `"fit"` a step of the training of the second one, and no more."""
    if scene == "fit":
        return _fit(build("bending", sk.Mesh.read(mesh)), 4 * runs)
    problem = build(scene, sk.Mesh.read(mesh))
    equilibrium, relaxation = profile(lambda problem: problem(), problem, runs=runs)
    energy, y, motions, solver = eqx.filter_jit(_at)(problem, equilibrium)
    derivatives = lambda energy, y: energy.derivatives(y)[:3]
    hessian = eqx.filter_jit(lambda energy, y: held_still(energy.hessian(y), motions, y)[0])(energy, y)
    pattern, still = problem.assembly.pattern, _sparse(energy, equilibrium)
    return {
        "unknowns": pattern.n,
        "nonzeros": pattern.nnz,
        "derivatives": profile(derivatives, still, y[: pattern.n], runs=runs)[1],
        "factorisation": profile(solver.factorise, hessian, runs=runs)[1],
        "relaxation": relaxation,
        "gradient": profile(_gradient, problem, runs=runs)[1],
        "steps": int(equilibrium.steps),
        "factorisations": int(equilibrium.factorisations),
        "converged": bool(equilibrium.converged),
        "force_norm": float(equilibrium.gradient_norm),
    }


def _at(problem: sk.InverseProblem, equilibrium: sk.Equilibrium):
    """Energy, unknowns, free motions and solver at an equilibrium; with multipliers where it has some."""
    energy, motions, solver = problem.discrete_energy(), problem.rigid_motions(), problem.linear_solver()
    y = problem.assembly.restrict(problem.assembly.join(equilibrium.vertices, equilibrium.directors))
    multipliers = equilibrium.multipliers
    if multipliers is None:
        return energy, y, motions, solver
    y = jnp.concatenate([y, multipliers])
    return Stationary(energy), y, padded(motions, len(multipliers)), BorderedSolver(solver)


def _sparse(energy, equilibrium: sk.Equilibrium):
    """The energy that a relaxation works on: under the forces that hold its quantities, where it has some."""
    multipliers = equilibrium.multipliers
    return energy if multipliers is None else energy.energy.held_by(multipliers, jnp.ones_like(multipliers))


def _fit(problem: sk.InverseProblem, steps: int) -> dict:
    """The seconds between the rows of a fit that moves by next to nothing."""
    result = sk.fit(problem, optax.sgd(1e-9), steps=steps, where=trained, progress=False)
    seconds = np.diff(result.history["seconds"])
    return {"gradient": {"first_s": float(seconds[0]), "run_s": seconds[1:].tolist()}}
