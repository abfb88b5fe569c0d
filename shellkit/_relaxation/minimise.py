"""The minimum of an energy, by Newton's method or another minimiser; with quantities of the whole shell held or not."""

import functools
import operator
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int, Scalar

from .._energy import DiscreteEnergy
from .._geometry.patches import Hinges, Triangles
from .._programs.tracing import with_parts
from .._solve.linear.base import AbstractSparseSolver, LastFactor
from .._solve.linear.bordered import BorderedSolver
from .._solve.matrices.operator import SparseSymmetric
from .._solve.newton.core import NewtonState
from .._solve.newton.newton import SparseNewton
from .._solve.newton.objective import MixedForm, NewtonObjective
from .._solve.null_space import gauged_hessian
from .augmented_lagrangian import ConstrainedState, relax_constrained
from .rigid_modes import RigidModes


FOLDED = 179.0  # degrees: a hinge beyond is folded flat
_TURN, _SHRINK = 0.34, 0.2  # no face may turn further than cos = 0.34 (70 degrees) or shrink below a fifth in one step


class End(eqx.Module):
    """Where a minimiser has come to, and how."""

    y: Float[Array, " n"]
    value: Scalar
    gradient: Float[Array, " n"]
    steps: Int[Array, ""]
    factorisations: Int[Array, ""]
    stable: Bool[Array, ""]
    result: optx.RESULTS
    last: LastFactor | None = None


def minimised(
    energy: DiscreteEnergy,
    y: Float[Array, " n"],
    motions: RigidModes | None,
    length: Scalar,
    solver: optx.AbstractMinimiser,
    linear_solver: AbstractSparseSolver,
    max_steps: int,
) -> End:
    """The minimum of an energy.

    **Arguments:**

    - `energy`: of which nothing is differentiated.
    - `y`: where to start.
    - `motions`: that cost nothing.
    - `length`: a typical one, such as that of an edge.
    - `solver`, `max_steps`: the minimiser and its limit.
    - `linear_solver`: that looks at the Hessian where the minimiser does not.
    """
    options = minimiser_options(energy, motions, length)
    solution = optx.minimise(lambda y, _: energy(y), solver, y, options=options, max_steps=max_steps, throw=False)
    steps = solution.stats["num_steps"]
    if isinstance(solution.state, NewtonState):
        state, result = solution.state, solution.result
        point, last, stable = state.best, state.factor, result == optx.RESULTS.successful
        assert isinstance(last, LastFactor)  # of a sparse matrix: there are no constraints here
        return End(point.y, point.value, point.gradient, steps, state.factorisations, stable, result, last)
    value, gradient = energy.value_and_gradient(solution.value)
    hessian = energy.hessian(solution.value)
    assert isinstance(hessian, SparseSymmetric)  # constraints are for SparseNewton, as was checked
    hessian, _, _ = gauged_hessian(hessian, motions, solution.value)
    factor = linear_solver.factorise(hessian)
    stable = factor.ok & (factor.negative <= 0)
    return End(solution.value, value, gradient, steps, jnp.ones((), jnp.int32), stable, solution.result)


def minimised_constrained(
    energy: DiscreteEnergy,
    y: Float[Array, " n"],
    multipliers: Float[Array, " m"] | None,
    motions: RigidModes | None,
    length: Scalar,
    solver: SparseNewton,
    max_steps: int,
) -> tuple[End, ConstrainedState]:
    """The minimum of an energy with its quantities at their values; also how it was found. See [`minimised`][]."""
    newton = with_parts(solver.core, linear_solver=BorderedSolver(solver.linear_solver))
    found = relax_constrained(newton, lambda e: objective_of(e, motions, length), energy, y, multipliers, max_steps)
    result = optx.RESULTS.where(
        found.settled | (found.result != optx.RESULTS.successful), found.result, optx.RESULTS.nonlinear_divergence
    )
    return End(found.y, found.value, found.gradient, found.steps, found.factorisations, found.settled, result), found


class Feasible(eqx.Module):
    """Whether a step turns no face too far and crushes none, as a line search that jumps over such states can fold the
    shell; and is not too long for any term of the energy."""

    energy: DiscreteEnergy

    def __call__(self, y: Float[Array, " n"], y_new: Float[Array, " n"]) -> Bool[Array, ""]:
        start, end = (self.energy.state(at).vertices for at in (y, y_new))
        longest = [elements.term.longest_step(start, end - start) for elements in self.energy.elements]
        feasible = [length >= 1 for length in longest if length is not None]
        if self.energy.faces is not None:
            mesh = self.energy.faces.mesh
            old, new = Triangles(start, mesh), Triangles(end, mesh)
            turn = jnp.sum(old.area_normal * new.area_normal, axis=0)
            kept = (turn > _TURN * old.twice_area * new.twice_area) & (new.twice_area > _SHRINK * old.twice_area)
            feasible.append(jnp.all(kept))
        return functools.reduce(operator.and_, feasible) if feasible else jnp.array(True)


class Folded(eqx.Module):
    """Whether a hinge is folded flat. There an averaged edge normal vanishes, and with it the force that would unfold
    it: no step leads away."""

    energy: DiscreteEnergy

    def __call__(self, y: Float[Array, " n"]) -> Bool[Array, ""]:
        assert self.energy.faces is not None
        faces, vertices = self.energy.faces, self.energy.state(y).vertices
        angles = Hinges(vertices, faces.mesh, Triangles(vertices, faces.mesh), faces.continuation).angles
        return jnp.max(jnp.abs(angles)) > jnp.deg2rad(FOLDED)


def objective_of(energy: DiscreteEnergy, motions: RigidModes | None, length: Scalar) -> NewtonObjective:
    """An energy as a Newton method is told of it."""
    # A shell that only stretches has no narrow valleys.
    bends = energy.faces is not None and energy.faces.form is not None and energy.constraints is None
    return NewtonObjective(
        value_and_gradient=energy.value_and_gradient,
        derivatives=energy.derivatives,
        structure=energy.blank_hessian,
        length=length,
        feasible=Feasible(energy),
        motions=motions,
        mixed=MixedForm(energy.faces_at, energy.derivatives_apart) if bends else None,
        hopeless=Folded(energy) if energy.faces is not None and energy.faces.folds else None,
    )


def minimiser_options(energy: DiscreteEnergy, motions: RigidModes | None, length: Scalar) -> dict[str, Any]:
    """What a minimiser of optimistix is told of an energy beside its value."""
    return {"objective": objective_of(energy, motions, length)}
