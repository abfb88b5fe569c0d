"""Second-order training: the least-squares solvers of optimistix as a method of the training loop. A step relaxes once
for each damping that is tried, and looks at the Jacobian once, whatever is refused."""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float, Int

from ..design import Design
from ..history import Scalar
from ..step import Evaluation, assess, move, relaxes_by_itself, strong
from .base import Course, Method
from .damping import Damped, Dogleg, Rule, Undamped
from .gauss_newton import Model, Plan, dense_model, krylov_model


_PRODUCTS, _TOLERANCE = 100, 1e-2  # of the search space, unless the solver says otherwise
_SUFFICIENT = 1e-4  # part of the promised decrease that is asked of a step
_ROUNDING = 1e-12  # relative decrease below which losses are as good as equal
_MISMATCH = 1e-4  # relative difference of the loss and the sum of squares at the start

_RULES: dict[type, type[Rule]] = {
    optx.GaussNewton: Undamped,
    optx.LevenbergMarquardt: Damped,
    optx.Dogleg: Dogleg,
}


@runtime_checkable
class SquaresTrainable(Protocol):
    """What second-order training asks of a problem beside `objective`."""

    def residuals(self, equilibrium: Any) -> Array:
        """The numbers whose squares sum to the loss, at what `objective` returned as the equilibrium; differentiable
        through it."""
        ...


class Standing(eqx.Module):
    """The state between two steps: the model at the last accepted design, its loss, the rule's control, and how many
    refusals in a row there have been."""

    model: Model
    loss: Float[Array, ""]
    control: Float[Array, ""]
    streak: Int[Array, ""]


class Details(NamedTuple):
    """What was found at an accepted design besides its loss and gradient."""

    model: Model
    loss: float


class SquaresMethod(Method):
    """A least-squares solver of optimistix: which one, its tolerances and norm, and how it looks at the Jacobian; and
    by what fraction the loss may rise in a step, `None` if it must fall."""

    def __init__(self, solver: optx.AbstractLeastSquaresSolver, max_rise: float | None):
        kind = next((known for known in _RULES if isinstance(solver, known)), None)
        if kind is None or not isinstance(solver, optx.AbstractGaussNewton):
            names = ", ".join(f"optimistix.{known.__name__}" for known in _RULES)
            raise ValueError(
                f"fit trains with the least-squares solvers {names}; got {type(solver).__name__}. Use one of them, or "
                "an optax optimiser."
            )
        self._kind = kind.__name__
        self._max_rise = max_rise
        self._rule = _RULES[kind]()
        self._rtol, self._atol, self._norm = float(solver.rtol), float(solver.atol), solver.norm
        self._linear_solver = _linear_solver(solver)
        self._default = type(self._linear_solver) is type(_linear_solver(kind(rtol=1e-3, atol=1e-3)))

    def begin(self, design: Design, values: dict[str, Array]) -> Course:
        free = strong(design.free(values))
        flat, _ = jax.flatten_util.ravel_pytree(free)
        m = _count_residuals(design, free)
        self._plan = self._planned(m, flat.size)
        standing = Standing(
            Model.empty(self._plan, m, flat.size, flat.dtype),
            jnp.asarray(np.inf),
            jnp.asarray(np.nan),
            jnp.zeros((), jnp.int32),
        )
        return Course(free, jax.tree.map(jnp.zeros_like, free), 1.0, standing)

    def propose(self, course: Course) -> dict[str, Array]:
        return move(course.anchor, course.update, jnp.ones(()))

    def evaluate(self, design: Design, free: dict[str, Array], start: Any) -> Evaluation:
        return assess(design, free, start)

    def complete(self, design: Design, found: Evaluation, course: Course) -> tuple[Evaluation, Details]:
        state = self._rated(course, float(found.loss))
        # Before the first step the damping is not known: the space is then made for a small one.
        damping = self._rule.damping(float(state.control)) if np.isfinite(state.control) else 0.0
        squares, gradient, norm, model = linearise(
            design, found.free, found.equilibrium, jnp.asarray(damping), self._plan
        )
        loss, squares = float(found.loss), float(squares)
        if not np.isfinite(state.loss) and abs(loss - squares) > _MISMATCH * max(abs(loss), abs(squares)):
            raise ValueError(
                f"the squares of the residuals sum to {squares:.9g}, but the loss is {loss:.9g}: residuals() and the "
                "loss of the problem must agree."
            )
        return eqx.tree_at(
            lambda e: (e.gradient, e.gradient_norm), found, (gradient, norm), is_leaf=lambda x: x is None
        ), Details(model, loss)

    def declines(self, course: Course, loss: float) -> bool:
        before = float(course.state.loss)
        if not np.isfinite(before):
            return False
        if self._max_rise is not None:
            return not loss <= before + self._max_rise * before
        promised = self._promised(course)
        # Where the loss has no digits left to fall by, a step that is small enough is let through once it is level.
        noise = _ROUNDING * abs(before)
        return not before - loss >= min(_SUFFICIENT * promised, promised - noise)

    def refused(self, course: Course) -> Course:
        state = course.state
        length = float(np.linalg.norm(self._coefficients(state)))
        control = self._rule.refused(float(state.control), length, int(state.streak) + 1)
        return self._towards(course, _with(state, control=control, streak=int(state.streak) + 1))

    def advance(self, design: Design, found: Evaluation, more: Details, course: Course, start: Any) -> Course:
        state = self._rated(course, more.loss)
        control = float(state.control)
        control = control if np.isfinite(control) else self._rule.begin(more.model)
        state = eqx.tree_at(lambda s: (s.model, s.loss), state, (more.model, jnp.asarray(np.float64(more.loss))))
        return self._towards(course._replace(anchor=found.free), _with(state, control=control, streak=0))

    def arrived(self, course: Course) -> bool:
        state = course.state
        if not np.isfinite(state.loss):
            return False
        y, step = (jax.flatten_util.ravel_pytree(tree)[0] for tree in (course.anchor, course.update))
        residual = np.linalg.norm(np.asarray(state.model.singular) * self._coefficients(state))
        near = self._norm(jnp.abs(step) / (self._atol + self._rtol * jnp.abs(y))) < 1
        return bool(near) and bool(residual < self._atol + self._rtol * np.sqrt(float(state.loss)))

    def columns(self, course: Course, more: Details) -> dict[str, Scalar]:
        return {"control": float(course.state.control), "products": int(more.model.products)}

    def choices(self) -> dict[str, str]:
        return {"solver": self._kind}

    def _rated(self, course: Course, loss: float) -> Standing:
        """The state with its control after the step of this course was accepted with this loss."""
        state = course.state
        if not np.isfinite(state.loss):
            return state
        promised = self._promised(course)
        gain = (float(state.loss) - loss) / promised if promised > 0 else 0.0
        length = float(np.linalg.norm(self._coefficients(state)))
        return _with(state, control=self._rule.accepted(float(state.control), length, gain), streak=0)

    def _promised(self, course: Course) -> float:
        return course.state.model.reduction(self._coefficients(course.state))

    def _coefficients(self, state: Standing) -> np.ndarray:
        return self._rule.step(state.model, float(state.control))

    def _towards(self, course: Course, state: Standing) -> Course:
        """The course along the step that this state asks for."""
        update = combine(state.model, jnp.asarray(self._coefficients(state)), course.anchor)
        return course._replace(update=update, state=state)

    def _planned(self, m: int, n: int) -> Plan:
        """How to look at a Jacobian of m rows and n columns: in full where that takes no more products."""
        inner = self._linear_solver
        inner = inner.inner_solver if isinstance(inner, lx.Normal) else inner
        if isinstance(inner, lx.CG | lx.LSMR):
            limit = inner.max_steps if isinstance(inner.max_steps, int) else _PRODUCTS
            return Plan(False, limit, float(inner.rtol))
        if self._default:
            return Plan(min(m, n) <= 2 * _PRODUCTS, _PRODUCTS, _TOLERANCE)
        return Plan(True, min(m, n), 0.0)


@eqx.filter_jit
def linearise(
    design: Design, free: dict[str, Array], equilibrium: Any, damping: Float[Array, ""], plan: Plan
) -> tuple[Float[Array, ""], dict[str, Array], Float[Array, ""], Model]:
    """The sum of squares at a design and its equilibrium, its gradient and the norm of that, and its local model."""
    residuals, push, pull, flat, unravel = jacobian(design, free, equilibrium)
    if plan.dense:
        slope, model = dense_model(push, pull, residuals, flat.size)
    else:
        slope, model = krylov_model(push, pull, residuals, flat.size, plan, damping)
    return jnp.sum(residuals**2), unravel(2 * slope), 2 * jnp.linalg.norm(slope), model


def jacobian(design: Design, free: dict[str, Array], equilibrium: Any) -> tuple[Array, Callable, Callable, Array, Any]:
    """The residuals at a design, products with their Jacobian and with its transpose, and the variables as a vector."""
    flat, unravel = jax.flatten_util.ravel_pytree(free)
    at = lambda x: design.problem(design.values(unravel(x))).residuals(equilibrium)
    residuals, push = jax.linearize(at, flat)
    transposed = jax.linear_transpose(push, flat)
    return residuals, push, lambda u: transposed(u)[0], flat, unravel


@eqx.filter_jit
def combine(model: Model, coefficients: Float[Array, " k"], like: dict[str, Array]) -> dict[str, Array]:
    """A step from its coefficients on the directions of a model, in the structure of a design."""
    _, unravel = jax.flatten_util.ravel_pytree(like)
    return strong(unravel(coefficients @ model.directions))


def _count_residuals(design: Design, free: dict[str, Array]) -> int:
    problem = design.problem(design.values(free))
    if relaxes_by_itself(problem):
        equilibrium = eqx.filter_eval_shape(lambda p: p.unrelaxed(), problem)
    else:
        equilibrium = eqx.filter_eval_shape(assess, design, free, None).equilibrium
    residuals = lambda d, x, equilibrium: d.problem(d.values(x)).residuals(equilibrium)
    return eqx.filter_eval_shape(residuals, design, free, equilibrium).size


def _with(state: Standing, control: float, streak: int) -> Standing:
    numbers = (jnp.asarray(np.float64(control)), jnp.asarray(np.int32(streak)))
    return eqx.tree_at(lambda s: (s.control, s.streak), state, numbers)


def _linear_solver(solver: Any) -> lx.AbstractLinearSolver:
    return solver.descent.linear_solver
