"""Newton's method with a sparse direct factorisation, globalised, as an optimistix minimiser."""

from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int, PyTree, Scalar

from .._papers import NOCEDAL_2006
from .choose import default_direct_solver
from .direct import AbstractSparseSolver, Factor
from .motions import coordinates_to_hold, hold, orthonormal, project_out
from .operator import SparseSymmetric


_ARMIJO = 1e-4  # part of the decrease that the slope promises
_NOISE = 64.0  # roundings of the energy below which a difference of energies says nothing
_MAX_HALVINGS = 40
_MAX_CORRECTIONS = 12
_CONTRACTION = 0.5  # corrections go on while each cuts the gradient to this or less: a tenth of the price of a factor
_SMALLEST_SHIFT, _LARGEST_SHIFT = 1e-4, 1e8  # in units of the mean diagonal entry
_SHIFT_GROWTH, _SHIFT_DECAY = 8.0, 0.1
_HALF_STRESS, _DAMPING = 1e-3, 1e-4  # the shift at which half the stress is left out, and the identity's part in it
_MAX_SHIFTS = 24
_FLOOR = 1e-5  # steps below this fraction of the typical length that lower nothing are rounding
_SADDLE = 1e-2  # steps below this fraction of the typical length, with a shift, may be at a saddle
_INVERSE_ITERATIONS = 8


class _Scene(eqx.Module):
    """What the method asks of the function that it minimises; see `SparseNewton`."""

    value: Callable[[Array], Scalar]
    gradient: Callable[[Array], Array]
    hessian: Callable[[Array], SparseSymmetric]
    feasible: Callable[[Array, Array], Bool[Array, ""]]
    motions: Callable[[Array], Array] | None
    length: Scalar
    stress: Callable[[Array], SparseSymmetric] | None


class _Point(eqx.Module):
    """A point with its energy and its gradient."""

    y: Float[Array, " n"]
    value: Scalar
    gradient: Float[Array, " n"]


class NewtonState(eqx.Module):
    """State of [`shellkit.SparseNewton`][] between two steps."""

    point: _Point
    shift: Scalar
    factor: Factor
    held: Int[Array, " k"] | None  # the coordinates that were held in the factor
    factorisations: Int[Array, ""]
    done: Bool[Array, ""]
    stuck: Bool[Array, ""]


class SparseNewton(optx.AbstractMinimiser):
    """Newton's method on the exact sparse Hessian, globalised so that it ends in a minimum or says why not.

    Each step factorises H + sI, where the shift s is raised until the inertia of the factor shows no negative
    eigenvalue
    and falls to zero near a minimum; takes the longest feasible step that lowers the energy; and, once close, adds
    cheap
    corrections with the same factor. A saddle is left along a direction of negative curvature. Motions that cost
    nothing are
    held and projected out.

    It works on one flat vector and is told about the function through `options` of `optimistix.minimise`:

    - `options["hessian"]`: `y -> ` the Hessian, a sparse symmetric operator. Required.
    - `options["gradient"]`: `y -> ` the gradient; by default that of automatic differentiation.
    - `options["stress"]`: `y -> ` the part of the Hessian that the others leave positive definite when it is taken
        away, over the same pattern: the second derivatives of strain, times stress.
    - `options["feasible"]`: `(y, y_new) -> bool`, whether a step may be taken.
    - `options["motions"]`: `y -> ` motions that cost nothing, shape (n, k).
    - `options["length"]`: a typical length, such as that of an edge, against which steps are measured; 1 by default.

    [`shellkit.InverseProblem`][] provides all of these. Not for functions whose Hessian is dense, and not for single
    precision.

    ??? cite "Source"

        The shift by inertia is Algorithm 3.3 of J. Nocedal and S. Wright, "Numerical Optimization", 2nd edition (2006),
        with a factorisation that reports the inertia (section 3.4).
    """

    papers: ClassVar[tuple[str, ...]] = (NOCEDAL_2006,)
    rtol: float
    max_steps: int = eqx.field(static=True)
    linear_solver: AbstractSparseSolver
    atol: float = 0.0
    norm: Callable[[PyTree], Scalar] = optx.max_norm

    def __init__(self, rtol: float = 1e-11, max_steps: int = 256, linear_solver: AbstractSparseSolver | None = None):
        """**Arguments:**

        - `rtol`: the relaxation ends when a full Newton step moves no unknown by more than this fraction of the typical
            length, which leaves the error far smaller still.
        - `max_steps`: the largest number of steps.
        - `linear_solver`: by default the best direct solver that is installed.
        """
        self.rtol = rtol
        self.max_steps = max_steps
        self.linear_solver = default_direct_solver() if linear_solver is None else linear_solver

    def _scene(self, fn, args, options: dict[str, Any]) -> _Scene:
        if "hessian" not in options:
            raise ValueError(
                'SparseNewton needs a sparse Hessian: pass options={"hessian": y -> operator} to optimistix.minimise, '
                "or use an InverseProblem, which does; optimistix.BFGS and optimistix.NonlinearCG need none."
            )
        value = lambda y: fn(y, args)[0]
        return _Scene(
            value=value,
            gradient=options.get("gradient", jax.grad(value)),
            hessian=options["hessian"],
            feasible=options.get("feasible", lambda y, y_new: jnp.array(True)),
            motions=options.get("motions"),
            length=jnp.asarray(options.get("length", 1.0)),
            stress=options.get("stress"),
        )

    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> NewtonState:
        scene = self._scene(fn, args, options)
        point = _Point(y, scene.value(y), scene.gradient(y))
        blank = jax.tree.map(
            lambda struct: jnp.zeros(struct.shape, struct.dtype),
            eqx.filter_eval_shape(lambda y: self.linear_solver.factorise(scene.hessian(y)), y),
        )
        zero = jnp.zeros((), jnp.int32)
        held = None if scene.motions is None else jnp.zeros(scene.motions(y).shape[1], int)
        return NewtonState(point, jnp.zeros(()), blank, held, zero, jnp.array(False), jnp.array(False))

    def step(self, fn, y, args, options, state: NewtonState, tags):
        scene = self._scene(fn, args, options)
        point = state.point
        basis = None if scene.motions is None else orthonormal(scene.motions(point.y))
        held = None if basis is None else coordinates_to_hold(basis)
        factor, shift, tries = self._factorise(scene, state, held)
        solve = lambda rhs: solve_held(self.linear_solver, factor, basis, held, rhs)
        direction = -solve(point.gradient)
        size = jnp.max(jnp.abs(direction))

        moved, length = _search(scene, point, direction)
        regular = (shift == 0) & _usable(factor)
        moved, settled = jax.lax.cond(
            regular & (length == 1) & (size < scene.length),
            lambda: _polish(scene, moved, solve, self.rtol),
            lambda: (moved, jnp.array(False)),
        )
        # No step lowers the energy: that is the rounding floor if the step left to take is tiny.
        stalled = length == 0
        settled = settled | (stalled & regular & (size < _FLOOR * scene.length))
        moved, escaped = jax.lax.cond(
            (shift > 0) & (stalled | (size < _SADDLE * scene.length)),
            lambda: _escape(scene, moved, solve),
            lambda: (moved, jnp.array(False)),
        )
        # The shift grows where the model was not to be trusted, and fades where it was.
        grown = jnp.maximum(shift, _SMALLEST_SHIFT) * _SHIFT_GROWTH
        # A shift that had to be raised within the step is kept; one that was enough at once fades fast.
        decayed = shift * jnp.where(tries > 1, 1.0, _SHIFT_DECAY)
        faded = jnp.where(decayed < _SMALLEST_SHIFT, 0.0, decayed)
        lost = stalled & ~escaped & ~settled
        shift = jnp.where(
            lost, grown * _SHIFT_GROWTH, jnp.where(length < 0.2, grown, jnp.where(length > 0.5, faded, shift))
        )
        stuck = (lost & (shift > _LARGEST_SHIFT)) | ~_usable(factor) | ~jnp.isfinite(moved.value)
        state = NewtonState(moved, shift, factor, held, state.factorisations + tries, settled, stuck & ~settled)
        return moved.y, state, None

    def _factorise(self, scene: _Scene, state: NewtonState, held) -> tuple[Factor, Scalar, Int[Array, ""]]:
        """Factorise H + sI with the smallest shift s tried, from the last one up, that leaves no negative
        eigenvalue."""
        hessian = scene.hessian(state.point.y)
        stress = None if scene.stress is None else scene.stress(state.point.y)
        unit = jnp.mean(jnp.abs(hessian.values[hessian.pattern.diagonal]))

        def attempt(carry):
            _, next_shift, _, tries = carry
            matrix = _shifted(hessian, stress, next_shift, unit)
            factor = self.linear_solver.factorise(matrix if held is None else hold(matrix, held))
            return factor, jnp.maximum(next_shift, _SMALLEST_SHIFT) * _SHIFT_GROWTH, next_shift, tries + 1

        unfit = lambda carry: (carry[3] == 0) | (~_usable(carry[0]) & (carry[3] < _MAX_SHIFTS))
        start = (state.factor, state.shift, state.shift, jnp.zeros((), jnp.int32))
        factor, _, shift, tries = jax.lax.while_loop(unfit, attempt, start)
        return factor, shift, tries

    def terminate(self, fn, y, args, options, state: NewtonState, tags):
        result = optx.RESULTS.where(state.stuck, optx.RESULTS.nonlinear_divergence, optx.RESULTS.successful)
        return state.done | state.stuck, result

    def postprocess(self, fn, y, aux, args, options, state: NewtonState, tags, result):
        return y, aux, {"factorisations": state.factorisations}


def _shifted(hessian: SparseSymmetric, stress: SparseSymmetric | None, shift: Scalar, unit: Scalar) -> SparseSymmetric:
    """The Hessian made more positive: by the identity, or where the part due to stress is known, by less of that.

    Compressed shells have negative eigenvalues far beyond the first one to buckle. With the identity the last, of short
    waves, is the softest direction that is left, and leads to crumpled states; with less stress it is the first.
    """
    if stress is None:
        return hessian.shifted(shift * unit)
    left_out = shift / (shift + _HALF_STRESS)
    less = SparseSymmetric(hessian.pattern, hessian.values - left_out * stress.values)
    # Once no stress is left, the identity takes over.
    return less.shifted(_DAMPING * shift * (1 + shift) ** 2 * unit)


def _usable(factor: Factor) -> Bool[Array, ""]:
    """Whether the matrix is positive definite; a solver that cannot count says so by failing."""
    return factor.ok & (factor.negative <= 0)


def solve_held(
    linear_solver: AbstractSparseSolver,
    factor: Factor,
    basis: Float[Array, "n k"] | None,
    held: Int[Array, " k"] | None,
    rhs: Float[Array, " n"],
) -> Float[Array, " n"]:
    """Apply the pseudo-inverse: solve with the coordinates `held`, off the motions in `basis`."""
    if basis is None:
        return linear_solver.solve(factor, rhs)
    rhs = project_out(basis, rhs).at[held].set(0.0)
    return project_out(basis, linear_solver.solve(factor, rhs))


def _search(scene: _Scene, point: _Point, direction: Float[Array, " n"]) -> tuple[_Point, Scalar]:
    """Halve the step until it is feasible and lowers the energy; the point reached and the length, zero if there is
    none.

    Where the energy has no digits left to fall by, a smaller gradient decides.
    """
    slope = point.gradient @ direction
    norm = jnp.linalg.norm(point.gradient)

    def attempt(carry):
        _, _, length, tries = carry
        y = point.y + length * direction
        trial = _Point(y, scene.value(y), scene.gradient(y))
        noise = _NOISE * jnp.finfo(y.dtype).eps * jnp.abs(point.value)
        lower = trial.value <= point.value + _ARMIJO * length * slope
        level = (jnp.abs(trial.value - point.value) <= noise) & (jnp.linalg.norm(trial.gradient) <= norm)
        accepted = scene.feasible(point.y, y) & (lower | level) & jnp.all(jnp.isfinite(trial.gradient))
        return trial, accepted, jnp.where(accepted, length, 0.5 * length), tries + 1

    unfit = lambda carry: ~carry[1] & (carry[3] < _MAX_HALVINGS)
    start = (point, slope > 0, jnp.ones_like(slope), 0)
    trial, accepted, length, tries = jax.lax.while_loop(unfit, attempt, start)
    accepted = accepted & (tries > 0)
    moved = jax.tree.map(lambda new, old: jnp.where(accepted, new, old), trial, point)
    return moved, jnp.where(accepted, length, 0.0)


def _polish(scene: _Scene, point: _Point, solve, rtol: float) -> tuple[_Point, Bool[Array, ""]]:
    """Corrections with the factor at hand while they shrink the gradient fast; and whether the last was within
    tolerance."""

    def correct(carry):
        point, _, _, count = carry
        correction = -solve(point.gradient)
        y = point.y + correction
        gradient = scene.gradient(y)
        ratio = jnp.linalg.norm(gradient) / jnp.linalg.norm(point.gradient)
        better = ratio < 1
        moved = _Point(jnp.where(better, y, point.y), point.value, jnp.where(better, gradient, point.gradient))
        settled = jnp.max(jnp.abs(correction)) <= rtol * scene.length
        return moved, settled, ratio < _CONTRACTION, count + 1

    on = lambda carry: ~carry[1] & carry[2] & (carry[3] < _MAX_CORRECTIONS)
    point, settled, _, _ = jax.lax.while_loop(on, correct, (point, jnp.array(False), jnp.array(True), 0))
    return _Point(point.y, scene.value(point.y), point.gradient), settled


def _escape(scene: _Scene, point: _Point, solve) -> tuple[_Point, Bool[Array, ""]]:
    """Leave a saddle along its direction of most negative curvature, found by inverse iteration on the shifted
    factor."""
    vector = jax.random.normal(jax.random.key(0), point.y.shape, point.y.dtype)
    refine = lambda _, v: (lambda w: w / jnp.max(jnp.abs(w)))(solve(v))
    vector = jax.lax.fori_loop(0, _INVERSE_ITERATIONS, refine, vector)
    vector = jnp.where(point.gradient @ vector > 0, -vector, vector)

    def attempt(carry):
        _, _, length, tries = carry
        y = point.y + length * vector
        trial = _Point(y, scene.value(y), scene.gradient(y))
        lower = trial.value < point.value - _NOISE * jnp.finfo(y.dtype).eps * jnp.abs(point.value)
        accepted = lower & scene.feasible(point.y, y) & jnp.all(jnp.isfinite(trial.gradient))
        return trial, accepted, 0.5 * length, tries + 1

    unfit = lambda carry: ~carry[1] & (carry[3] < _MAX_HALVINGS)
    trial, accepted, _, _ = jax.lax.while_loop(unfit, attempt, (point, jnp.array(False), scene.length, 0))
    return jax.tree.map(lambda new, old: jnp.where(accepted, new, old), trial, point), accepted
