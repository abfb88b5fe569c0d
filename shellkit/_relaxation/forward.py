"""The forward pass and its derivative as programs: what is compiled, once for a kind of problem, and by whom it is
shared. Values are arguments; a problem is one, without its loss."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float, Scalar

from .._actuation import Actuation
from .._align.aligners import Kabsch
from .._energy import DiscreteEnergy
from .._equilibrium import RESULTS, Diagnostics, Equilibrium, Pose
from .._geometry.patches import Hinges, Triangles
from .._geometry.surface import edge_lengths
from .._loss import Loss
from .._mesh.mesh import Mesh
from .._programs.compiling import FAST, program
from .._programs.tracing import frozen, with_parts
from .._programs.waiting import announce
from .._rest import RestShape
from .._solve.adjoint import MANY, differentiable_minimum
from .._solve.linear.bordered import BorderedSolver
from .._solve.newton.newton import SparseNewton
from .._solve.newton.plain import PlainNewton
from .._solve.response import responding_minimum
from .augmented_lagrangian import Stationary, differentiable_constrained, padded
from .minimise import FOLDED, End, minimised, minimised_constrained
from .relaxed import Relaxed, Start
from .rigid_modes import RigidModes


@program(FAST)
def relax(problem: Any, start: Start, plain: bool) -> Relaxed:
    """The relaxation of a problem: the only program with a loop over steps, for all problems of a kind.

    **Arguments:**

    - `problem`: without its loss.
    - `start`: where to begin.
    - `plain`: whether with no more of [`shellkit.SparseNewton`][] than its plain steps, which compiles far faster.
    """
    announce("the relaxation of this kind of scene")
    rest = problem.rest_shape()
    energy = problem.energy_of(rest)
    y0 = problem.assembly.dofs.gather(start.unknowns)
    motions = problem.rigid_modes(energy)
    length = jnp.mean(edge_lengths(problem.mesh.vertices, problem.mesh))
    linear_solver, solver = problem.linear_solver(), PlainNewton(problem.solver) if plain else problem.solver
    multipliers = last = None
    if energy.constraints is None:
        end = minimised(energy, y0, motions, length, solver, linear_solver, problem.step_limit())
        y, last = end.y, end.last if len(y0) >= MANY else None
    else:
        assert isinstance(solver, SparseNewton)  # as was checked when the problem was built
        end, found = minimised_constrained(energy, y0, start.multipliers, motions, length, solver, problem.step_limit())
        y, multipliers = found.y, found.multipliers
    pose = pose_of(problem, energy, y, motions, multipliers)
    stuck = end.result == optx.RESULTS.nonlinear_divergence
    return Relaxed(rest, pose, _diagnostics(problem.mesh, energy, end, pose.unknowns.vertices), y, stuck, last)


@eqx.filter_jit
def respond(problem: Any, found: Relaxed, posed: bool) -> tuple[RestShape, Pose]:
    """Rest shape and pose as functions of every array of a problem, at a relaxation that was found."""
    rest = problem.rest_shape()
    energy = problem.energy_of(rest)
    motions = frozen(problem.rigid_modes(energy))
    linear_solver, multipliers = problem.linear_solver(), found.pose.multipliers
    if multipliers is None:
        last = None if found.last is None else (found.last, problem.assembly.pattern)
        y = differentiable_minimum(energy, found.y, motions, linear_solver, last)
    else:
        y, multipliers = differentiable_constrained(energy, found.y, multipliers, motions, linear_solver)
    if not posed:
        return rest, Pose(energy.state(y), multipliers=multipliers)
    return rest, pose_of(problem, energy, y, motions, multipliers)


@eqx.filter_jit
def near(problem: Any, equilibrium: Equilibrium) -> tuple[RestShape, Pose]:
    """Rest shape and pose as functions of every array of a problem, to first order, at an equilibrium."""
    rest = problem.rest_shape()
    energy, solver = problem.energy_of(rest), problem.linear_solver()
    y = problem.assembly.dofs.gather(equilibrium.unknowns)
    motions, multipliers = frozen(problem.rigid_modes(energy)), equilibrium.multipliers
    if multipliers is None:
        y = responding_minimum(energy, y, motions, solver)
    else:
        z, m = jnp.concatenate([y, multipliers]), len(multipliers)
        z = responding_minimum(Stationary(energy), z, padded(motions, m), BorderedSolver(solver))
        y, multipliers = z[:-m], z[-m:]
    return rest, pose_of(problem, energy, y, motions, multipliers)


@eqx.filter_jit
def assess(loss: Loss, equilibrium: Equilibrium, actuation: Actuation) -> tuple[Scalar, dict[str, Scalar]]:
    """A loss and its terms by name."""
    return loss.evaluate(equilibrium, actuation)


def pose_of(
    problem: Any,
    energy: DiscreteEnergy,
    y: Float[Array, " n"],
    motions: RigidModes | None = None,
    multipliers: Float[Array, " m"] | None = None,
) -> Pose:
    """What [`shellkit.Equilibrium`][] reports of a shape.

    Of a free shell the pose is that nearest to the surface at rest, with no net translation or rotation.

    **Arguments:**

    - `energy`: as `discrete_energy` returns it.
    - `y`: the vector of free unknowns.
    - `motions`: as `rigid_modes` returns them, if they are at hand.
    - `multipliers`: of what is held exactly or by springs; `None` where nothing is.
    """
    at, dofs = energy.state(y), problem.assembly.dofs
    energy = energy if multipliers is None else energy.with_multipliers(multipliers)
    reactions, moments = None, energy.held_moments(y)
    if dofs.free is not None:
        held = energy.full_gradient(y).at[dofs.free].set(0.0)
        reactions = dofs.unpack_forces(held).vertices
    if problem.supports is None:
        # The pose is that nearest to the start: no net translation or rotation of the displacement.
        vertices = brought_back = Kabsch()(at.vertices, problem.mesh.vertices)
        motions = problem.rigid_modes(energy) if motions is None else motions
        if motions is not None and motions.hindrances is not None:
            vertices = jnp.where(frozen(motions).are_free(jax.lax.stop_gradient(y)), brought_back, at.vertices)
        at = with_parts(at, vertices=vertices)
    return Pose(at, reactions, moments, multipliers)


def _diagnostics(mesh: Mesh, energy: DiscreteEnergy, end: End, vertices: Float[Array, "V 3"]) -> Diagnostics:
    converged = end.result == optx.RESULTS.successful
    result = RESULTS.promote(end.result)
    result = RESULTS.where(end.result == optx.RESULTS.nonlinear_divergence, RESULTS.stuck, result)
    worst_hinge = None
    if energy.faces is not None and energy.faces.form is not None:
        angles = jnp.abs(Hinges(vertices, mesh, Triangles(vertices, mesh)).angles)
        flat = jnp.argmax(angles)
        worst_hinge = mesh.face_edges.T.reshape(-1)[flat]
        folded = ~converged & (jnp.max(angles) > jnp.deg2rad(FOLDED))
        name = RESULTS.hinge_folded if energy.faces.folds else RESULTS.hinge_pressed
        result = RESULTS.where(folded, name, result)
    return Diagnostics(
        energy=end.value,
        gradient_norm=jnp.linalg.norm(end.gradient),
        steps=end.steps.astype(jnp.int32),
        factorisations=end.factorisations,
        converged=converged,
        stable=end.stable,
        result=result,
        worst_hinge=worst_hinge,
    )
