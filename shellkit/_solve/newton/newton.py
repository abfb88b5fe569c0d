"""Newton's method with a sparse direct factorisation, globalised, as an optimistix minimiser."""

from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int, PyTree, Scalar

from ..._citation.papers import GILL_1981, MAGISANO_2017, NOCEDAL_2006, TERAN_2005
from ..linear.base import AbstractSparseSolver, Factor
from ..linear.bordered import Bordered, BorderedFactor
from ..linear.choose import default_direct_solver
from ..matrices.operator import SparseSymmetric
from ..null_space import coordinates_to_hold, orthonormal, project_out
from .mixed import Apart, Mixed
from .points import Point, choose
from .saddle import away_from_saddle


_ARMIJO = 1e-4  # part of the decrease that the slope promises
_NOISE = 64.0  # roundings of the energy below which a difference of energies says nothing
_MAX_HALVINGS = 40
_MAX_CORRECTIONS = 24
_CONTRACTION = 0.5  # corrections go on while each cuts the gradient to this or less
_PATIENCE = 8.0  # and while no more of them than this seem to be left: a step costs as much as seven
_MEMORY = 8  # corrections that the next one learns from
_SMALLEST_SHIFT, _LARGEST_SHIFT = 1e-4, 1e8  # in units of the mean diagonal entry
_SHIFT_GROWTH, _SHIFT_DECAY = 4.0, 0.1
_HALF_CONVEX, _DAMPING = 1e-3, 1e-6  # the shift at which the model is half convex, and the identity's part in it
_MAX_SHIFTS = 8
SHORT = 0.2  # a step that is cut to less than this part says that its model is not to be trusted
_FLOOR = 1e-5  # steps below this fraction of the typical length may be too small for the energy to show
_MAX_HOPELESS = 3
_SADDLE = 1e-2  # steps below this fraction of the typical length, with a shift, may be at a saddle


_Convexification = Callable[[], SparseSymmetric]


class Scene(eqx.Module):
    """What the method asks of the function that it minimises; see [`shellkit.SparseNewton`][]."""

    value_and_gradient: Callable[[Array], tuple[Scalar, Array]]
    derivatives: Callable[[Array], tuple[Scalar, Array, SparseSymmetric | Bordered, _Convexification | None]]
    feasible: Callable[[Array, Array], Bool[Array, ""]]
    motions: Callable[[Array], Array] | None
    length: Scalar
    apart: Apart | None
    hopeless: Callable[[Array], Bool[Array, ""]] | None
    structure: Callable[[Array], SparseSymmetric | Bordered]  # a matrix like the Hessian, whose values do not count


def scene_of(fn: Any, args: Any, options: dict[str, Any]) -> Scene:
    """What the options of a minimiser say of the function."""
    if "hessian" not in options and "derivatives" not in options:
        raise ValueError(
            'SparseNewton needs a sparse Hessian: pass options={"hessian": y -> operator} to optimistix.minimise, '
            "or use an InverseProblem, which does; optimistix.BFGS and optimistix.NonlinearCG need none."
        )
    first = options.get("value_and_gradient", jax.value_and_grad(lambda y: fn(y, args)[0]))
    derivatives = options.get("derivatives", lambda y: (*first(y), options["hessian"](y), None))
    return Scene(
        value_and_gradient=first,
        derivatives=derivatives,
        feasible=options.get("feasible", lambda y, y_new: jnp.array(True)),
        motions=options.get("motions"),
        length=jnp.asarray(options.get("length", 1.0)),
        apart=None if options.get("apart") is None else Apart(*options["apart"]),
        hopeless=options.get("hopeless"),
        structure=options.get("structure", lambda y: derivatives(y)[2]),
    )


class NewtonState(eqx.Module):
    """State of [`shellkit.SparseNewton`][] between two steps."""

    point: Point
    shift: Scalar
    factor: Factor | BorderedFactor
    factorisations: Int[Array, ""]
    leaving: Bool[Array, ""]  # a saddle was reached: the next step leads off it
    mixed: Mixed | None
    hopeless: Int[Array, ""] | None  # for how many steps it has been
    done: Bool[Array, ""]
    stuck: Bool[Array, ""]

    @property
    def best(self) -> Point:
        """Where the search is; in the midst of mixed steps, where they began."""
        mixed = self.mixed
        return self.point if mixed is None else choose(mixed.on, mixed.origin, self.point)


class SparseNewton(optx.AbstractMinimiser):
    """Newton's method on the exact sparse Hessian, globalised so that it ends in a minimum or says why not.

    Each step factorises the Hessian with a shift that is raised until the inertia of the factor shows no negative
    eigenvalue and falls to zero near a minimum; takes the longest feasible step that lowers the energy; and, once
    close, adds quasi-Newton corrections with the same factor, each a fraction of the price of a step. A saddle is left
    along its softest direction, or its lowest. Where the step of a convex model has to be cut short, as the energy of a
    thin shell is a narrow curved valley, steps with the strains as unknowns of their own follow it to its end, or are
    dropped. Motions that cost nothing are held and projected out.

    It works on one flat vector and is told about the function through `options` of `optimistix.minimise`:

    - `options["hessian"]`: `y -> ` the Hessian, a sparse symmetric operator. Required, unless there is
    - `options["derivatives"]`: `y -> ` value, gradient, Hessian, and `() -> ` what makes it positive semidefinite when
        it is added, another such operator; or `None`, and a multiple of the identity is added where it must.
    - `options["value_and_gradient"]`: `y -> ` both; by default by automatic differentiation.
    - `options["feasible"]`: `(y, y_new) -> bool`, whether a step may be taken.
    - `options["motions"]`: `y -> ` motions that cost nothing, shape (n, k).
    - `options["length"]`: a typical length, such as that of an edge, against which steps are measured; 1 by default.
    - `options["apart"]`: the energy with its strains as unknowns of their own, for steps in narrow valleys: a pair of
        `y -> ` the strains, and `(y, strains, at_strains) -> ` what `options["derivatives"]` gives, at those strains or
        at those of `y`, and `step -> ` the strains to which it leads. Without it there are no such steps.
    - `options["hopeless"]`: `y -> bool`, whether no minimum can be found from there. Three steps in a row at such
        points end the search.
    - `options["structure"]`: `y -> ` a matrix of the structure of the Hessian, whose values do not count. It saves
        tracing the Hessian twice.

    [`shellkit.InverseProblem`][] provides all of these. Not for functions whose Hessian is dense, and not for single
    precision.

    ??? cite "Source"

        The shift by inertia is Algorithm 3.3 of J. Nocedal and S. Wright, "Numerical Optimization", 2nd edition (2006),
        with a factorisation that reports the inertia (section 3.4); the corrections are those of its Algorithm 7.4
        (L-BFGS), begun from the factor. What makes the Hessian of a shell convex is a modified Cholesky factorisation
        of P. Gill, W. Murray and M. Wright, "Practical Optimization" (1981), section 4.4.2.2, face by face; elements of
        other energies keep the positive part of theirs, as in J. Teran, E. Sifakis, G. Irving and R. Fedkiw, "Robust
        quasistatic finite elements and flesh simulation", Proc. ACM SIGGRAPH/Eurographics Symposium on Computer
        Animation (2005), 181–190. The steps in narrow valleys follow D. Magisano, L. Leonetti and G. Garcea, "How to
        improve efficiency and robustness of the Newton method in geometrically non-linear structural problem
        discretized via displacement-based finite elements", Comput. Methods Appl. Mech. Eng. 313 (2017) 986–1005.
    """

    papers: ClassVar[tuple[str, ...]] = (NOCEDAL_2006, GILL_1981, TERAN_2005, MAGISANO_2017)
    rtol: float
    max_steps: int = eqx.field(static=True)
    linear_solver: AbstractSparseSolver
    atol: float
    norm: Callable[[PyTree], Scalar]

    def __init__(self, rtol: float = 1e-11, max_steps: int = 256, linear_solver: AbstractSparseSolver | None = None):
        """**Arguments:**

        - `rtol`: the relaxation ends when a full Newton step moves no unknown by more than this fraction of the typical
            length, which leaves the error far smaller still.
        - `max_steps`: the largest number of steps.
        - `linear_solver`: by default the best direct solver that is installed.
        """
        self.rtol = rtol
        self.atol = 0.0
        self.norm = optx.max_norm
        self.max_steps = max_steps
        self.linear_solver = default_direct_solver() if linear_solver is None else linear_solver

    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> NewtonState:
        scene = scene_of(fn, args, options)
        # The first step evaluates where it stands, as every step does.
        zero = jnp.zeros((), y.dtype)
        nowhere = Point(y, zero, jnp.zeros_like(y), zero)
        solver: Any = self.linear_solver  # of sparse matrices, or of bordered ones
        blank = blank_like(lambda y: solver.factorise(scene.structure(y)), y)
        no = jnp.array(False)
        mixed = None
        if scene.apart is not None:
            mixed = Mixed.off(blank_like(scene.apart.begin, y), nowhere)
        none = jnp.zeros((), jnp.int32)
        hopeless = None if scene.hopeless is None else none
        return NewtonState(nowhere, jnp.zeros(()), blank, none, no, mixed, hopeless, no, no)

    def step(self, fn, y, args, options, state: NewtonState, tags):
        scene = scene_of(fn, args, options)
        free, ahead, mixed = jnp.array(False), None, state.mixed
        if scene.apart is None or mixed is None:
            value, gradient, hessian, convexification = scene.derivatives(y)
        else:
            free = mixed.on
            value, gradient, hessian, convexification, ahead = scene.apart.derivatives(y, mixed.strains, free)
        point = Point.of(y, value, gradient)
        basis = None if scene.motions is None else orthonormal(scene.motions(y))
        held = None if basis is None else coordinates_to_hold(basis)
        factor, newton, shift, tries = self._factorise(
            state, hessian, convexification, basis, held, -gradient, jnp.where(free, 1, _MAX_SHIFTS)
        )
        # A direction that is none shows in the energy.
        solve = lambda rhs: solve_held(self.linear_solver, factor, basis, rhs, checked=False)
        direction = jax.lax.cond(
            state.leaving,
            lambda: away_from_saddle(hessian.mv, solve, gradient, scene.length),
            lambda: newton,
        )
        size = jnp.max(jnp.abs(direction))
        regular = (shift == 0) & usable(factor) & ~state.leaving
        moved, length, settled = descend(scene, point, direction, size, solve, state.leaving, regular, free, self.rtol)

        stalled = length == 0
        settled = settled | (regular & ~free & floored(size, length, scene, self.rtol))
        small = size < _SADDLE * scene.length
        # More than one try means that the matrix was just seen not to be definite.
        leaving = (shift > 0) & ~state.leaving & (stalled | (small & (tries > 1)))
        # The shift grows where the model was not to be trusted, and fades where it was.
        grown = jnp.maximum(shift, _SMALLEST_SHIFT) * _SHIFT_GROWTH
        # A shift that had to be raised within the step is kept; one that was enough at once fades fast.
        decayed = shift * jnp.where(tries > 1, 1.0, _SHIFT_DECAY)
        faded = jnp.where((decayed < _SMALLEST_SHIFT) | (small & (tries == 1)), 0.0, decayed)
        lost = stalled & ~state.leaving & ~settled & ~free
        after = jnp.where(length < SHORT, grown, jnp.where(length > 0.5, faded, shift))
        shift = jnp.where(lost, grown * _SHIFT_GROWTH, jnp.where(state.leaving & stalled, shift, after))
        stuck = (lost & (shift > _LARGEST_SHIFT)) | ~usable(factor) | ~jnp.isfinite(moved.value)
        stuck = stuck & ~settled & ~free
        hopeless = state.hopeless
        if scene.hopeless is not None and hopeless is not None:
            hopeless = jnp.where(scene.hopeless(y), hopeless + 1, 0)
            stuck = stuck | (~settled & (hopeless >= _MAX_HOPELESS))
        if mixed is not None and ahead is not None:
            trusted = regular & ~settled & ~stuck
            mixed, moved = mixed.after(
                point, direction, size, moved, length, trusted, scene.length, lambda: ahead(direction)
            )
            # Steps of this kind have no shift; those that follow begin without.
            shift = jnp.where(mixed.on | free, 0.0, shift)
        state = NewtonState(
            moved, shift, factor, state.factorisations + tries, leaving, mixed, hopeless, settled, stuck
        )
        return moved.y, state, None

    def _factorise(
        self,
        state: NewtonState,
        hessian: SparseSymmetric | Bordered,
        convexification: _Convexification | None,
        basis: Float[Array, "n k"] | None,
        held: Int[Array, " k"] | None,
        rhs: Array,
        max_tries: Array,
    ) -> tuple[Factor | BorderedFactor, Float[Array, " n"], Scalar, Int[Array, ""]]:
        """Factorise the Hessian with the smallest shift tried, from the last one up, that leaves no negative
        eigenvalue; and solve for one right-hand side."""
        unit = hessian.size_of_diagonal()
        solver: Any = self.linear_solver
        rhs = project_out(basis, rhs)
        hessian = hessian if held is None else hessian.gauged(held, unit)

        def attempt(carry):
            _, _, next_shift, last_shift, tries, lift = carry
            if convexification is None:
                matrix = hessian.shifted(next_shift * unit)
            else:
                # Worked out at the first shift of this step.
                first = (next_shift > 0) & ((tries == 0) | (last_shift == 0))
                lift = jax.lax.cond(first, lambda make: make().values, lambda _: lift, convexification)
                matrix = _convexified(hessian, lift, next_shift, unit)
            factor, solution = solver.factorise_and_solve(matrix, rhs)
            # A try costs as much as a step: they lie ever further apart, at first too, where the way is long.
            stride = tries + jnp.where(state.factorisations == 0, 3, 1)
            higher = jnp.maximum(next_shift, _SMALLEST_SHIFT) * _SHIFT_GROWTH ** stride.astype(float)
            return factor, solution, higher, next_shift, tries + 1, lift

        unfit = lambda carry: (carry[4] == 0) | (~usable(carry[0]) & (carry[4] < max_tries))
        sparse = hessian.sparse if isinstance(hessian, Bordered) else hessian
        no_lift = None if convexification is None else jnp.zeros_like(sparse.values)
        start = (state.factor, rhs, state.shift, state.shift, jnp.zeros((), jnp.int32), no_lift)
        factor, solution, _, shift, tries, _ = jax.lax.while_loop(unfit, attempt, start)
        return factor, project_out(basis, solution), shift, tries

    def terminate(self, fn, y, args, options, state: NewtonState, tags):
        result = optx.RESULTS.where(state.stuck, optx.RESULTS.nonlinear_divergence, optx.RESULTS.successful)
        return state.done | state.stuck, result

    def postprocess(self, fn, y, aux, args, options, state: NewtonState, tags, result):
        return state.best.y, aux, {"factorisations": state.factorisations}


def _convexified(
    hessian: SparseSymmetric | Bordered, lift: Float[Array, " nnz"], shift: Scalar, unit: Scalar
) -> SparseSymmetric | Bordered:
    """The Hessian with a part of what makes it convex, all of it as the shift grows.

    Compressed shells have negative eigenvalues far beyond the first one to buckle. With a multiple of the identity the
    last of them, of short waves, becomes the softest direction that is left, and leads to crumpled states; a convex
    model keeps the order of the modes.
    """
    part = shift / (shift + _HALF_CONVEX)
    # What other terms may have of negative curvature is left to the identity, once nothing else helps.
    damping = _DAMPING * shift * (1 + shift) ** 2 * unit
    return hessian.plus(part * lift).shifted(damping)


def blank_like(function: Callable[[Array], Any], y: Float[Array, " n"]) -> Any:
    """Zeros in the structure of what a function returns, which is not called."""
    structure = eqx.filter_eval_shape(function, y)
    return jax.tree.map(lambda struct: jnp.zeros(struct.shape, struct.dtype), structure)


def floored(size: Scalar, length: Scalar, scene: Scene, rtol: float) -> Bool[Array, ""]:
    """Whether a Newton step is within tolerance, or so tiny that it is made of rounding, as even the gradient rejects
    it."""
    return ((size < _FLOOR * scene.length) & (length < SHORT)) | (size <= rtol * scene.length)


def usable(factor: Factor | BorderedFactor) -> Bool[Array, ""]:
    """Whether the matrix is positive definite; a solver that cannot count says so by failing."""
    return factor.ok & (factor.negative <= 0)


def solve_held(
    linear_solver: Any,
    factor: Factor | BorderedFactor,
    basis: Float[Array, "n k"] | None,
    rhs: Float[Array, " n"],
    checked: bool = True,
) -> Float[Array, " n"]:
    """Apply the pseudo-inverse, off the motions in `basis`, by the factor of a matrix with springs on as many
    coordinates."""
    return project_out(basis, linear_solver.solve(factor, project_out(basis, rhs), checked))


class _Descent(eqx.Module):
    """Where a step has come to: first the search along its direction, then corrections with its factor."""

    point: Point
    direction: Float[Array, " n"]
    size: Scalar  # the largest entry of that
    length: Scalar
    tries: Int[Array, ""]
    searching: Bool[Array, ""]
    going: Bool[Array, ""]
    settled: Bool[Array, ""]
    memory: "_Memory"


def descend(
    scene: Scene,
    point: Point,
    direction: Float[Array, " n"],
    size: Scalar,
    solve: Callable[[Array], Array],
    leaving: Bool[Array, ""],
    regular: Bool[Array, ""],
    free: Bool[Array, ""],
    rtol: float,
) -> tuple[Point, Scalar, Bool[Array, ""]]:
    """Halve the step until it is feasible and lowers the energy, or double it while that lowers it further; then,
    near a minimum, correct it as long as that pays. A `free` step is taken as it is.

    One loop does both, so that the energy is compiled once.

    **Returns:** the point reached; the length of the step, zero if there was none to take; and whether the last
    correction was within tolerance.
    """
    slope = point.gradient @ direction
    near = regular & ~free & (size < scene.length)
    # An energy close to zero is a sum of squares of differences: it has fewer digits than its size says.
    tiny = regular & (size < _FLOOR * scene.length)
    noise = jnp.where(tiny, jnp.inf, _NOISE * jnp.finfo(point.y.dtype).eps * jnp.abs(point.value))

    def attempt(now: _Descent) -> _Descent:
        y = now.point.y + jnp.where(now.searching, now.length, 1.0) * now.direction
        trial = Point.of(y, *scene.value_and_gradient(y))
        ratio = trial.norm / now.point.norm

        # Where the energy has no digits left to fall by, a smaller gradient decides; not so at a saddle.
        lower = trial.value <= point.value + _ARMIJO * now.length * slope
        level = (jnp.abs(trial.value - point.value) <= noise) & (ratio <= 1) & ~leaving
        downwards = trial.value < now.point.value - noise
        further = now.length > 1
        found = scene.feasible(now.point.y, y) & jnp.where(leaving | further, downwards, lower | level)
        better = (trial.value <= now.point.value + noise) & (ratio < 1)
        accepted = trial.finite & (free | jnp.where(now.searching, found, better))

        target = rtol * scene.length
        settled = ~now.searching & (now.size <= target)
        left = jnp.log(now.size * ratio / target) / -jnp.log(ratio)
        pays = jnp.where(now.searching, near & (now.length == 1), (ratio < _CONTRACTION) & (left < _PATIENCE))
        correcting = accepted & pays & ~settled & (now.searching | (now.tries < _MAX_CORRECTIONS))
        # Off a saddle steps double while it goes down; so do short ones where the model is stiffer than the energy.
        short = now.length * now.size < 0.5 * scene.length
        stiffer = ~regular & (further | (accepted & (now.length == 1) & short))
        away = jnp.where(leaving, accepted | (now.point.value < point.value), stiffer)
        retrying = now.searching & jnp.where(away, accepted, ~accepted) & (now.tries < _MAX_HALVINGS)
        next_length = now.length * jnp.where(away, 2.0, 0.5)
        memory, ahead = jax.lax.cond(
            correcting,
            lambda: now.memory.correct(now.searching, now.direction, trial.gradient, now.point.gradient, solve),
            lambda: (now.memory, now.direction),
        )
        return _Descent(
            point=jax.tree.map(lambda new, old: jnp.where(accepted, new, old), trial, now.point),
            direction=ahead,
            size=jnp.max(jnp.abs(ahead)),
            length=jnp.where(retrying, next_length, jnp.where(now.searching & ~accepted & ~away, 0.0, now.length)),
            tries=jnp.where(correcting & now.searching, 0, now.tries + 1),
            searching=retrying,
            going=retrying | correcting,
            settled=settled,
            memory=memory,
        )

    downhill = (slope <= 0) | leaving
    zero, yes, no = jnp.zeros((), int), jnp.array(True), jnp.array(False)
    start = _Descent(point, direction, size, jnp.ones_like(slope), zero, yes, downhill, no, _Memory.blank(point.y))
    end = jax.lax.while_loop(lambda now: now.going, attempt, start)
    return end.point, jnp.where(downhill, end.length, 0.0), end.settled


class _Memory(eqx.Module):
    """Steps of the corrections so far and the changes of the gradient that they made, the latest last."""

    steps: Float[Array, "m n"]
    changes: Float[Array, "m n"]

    @classmethod
    def blank(cls, y: Float[Array, " n"]) -> "_Memory":
        """A memory of nothing."""
        return cls(jnp.zeros((_MEMORY, *y.shape), y.dtype), jnp.zeros((_MEMORY, *y.shape), y.dtype))

    def correct(
        self, first: Bool[Array, ""], step: Array, gradient: Array, last: Array, solve: Callable[[Array], Array]
    ) -> tuple["_Memory", Float[Array, " n"]]:
        """The memory with what the last correction taught, and the next: L-BFGS with the factor's inverse inside.

        The step of the search itself is not learnt from: it was long, and the curvature along it is not that here.
        """
        shifted = _Memory(
            jnp.concatenate([self.steps[1:], step[None]]), jnp.concatenate([self.changes[1:], (gradient - last)[None]])
        )
        memory = jax.tree.map(lambda new, old: jnp.where(first, old, new), shifted, self)
        curvatures = jnp.sum(memory.steps * memory.changes, axis=1)
        inverses = jnp.where(curvatures > 0, 1.0 / jnp.where(curvatures > 0, curvatures, 1.0), 0.0)

        def back(i, carry):
            rest, weights = carry
            k = _MEMORY - 1 - i
            weight = inverses[k] * (memory.steps[k] @ rest)
            return rest - weight * memory.changes[k], weights.at[k].set(weight)

        def forth(k, ahead):
            return ahead + (weights[k] - inverses[k] * (memory.changes[k] @ ahead)) * memory.steps[k]

        rest, weights = jax.lax.fori_loop(0, _MEMORY, back, (gradient, jnp.zeros(_MEMORY)))
        return memory, -jax.lax.fori_loop(0, _MEMORY, forth, solve(rest))
