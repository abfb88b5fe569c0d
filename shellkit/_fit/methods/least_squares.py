"""Second-order training of a loss that is a sum of squares. A step relaxes once for each damping that is tried, and
looks at the Jacobian once, whatever is refused."""

import abc
from collections.abc import Callable
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float, Int, PyTree, Scalar

from ..design import Design
from ..step import Evaluation, assess, relaxes_by_itself, strong
from .base import Accepted, Course, Method, Objective
from .gauss_newton import Model, Products, dense_model, krylov_model
from .rules import DoglegRadius, NielsenDamping, Rule, StepHalving


_SUFFICIENT = 1e-4  # part of the promised decrease that is asked of a step
_ROUNDING = 1e-12  # relative decrease below which losses are as good as equal
_MISMATCH = 1e-4  # relative difference of the loss and the sum of squares at the start


@runtime_checkable
class SquaresTrainable(Protocol):
    """What second-order training asks of a problem beside `objective`."""

    def residuals(self, equilibrium: Any) -> Array:
        """The numbers whose squares sum to the loss, at what `objective` returned as the equilibrium; differentiable
        through it."""
        ...


class Standing(eqx.Module):
    """The state between two steps: the model at the last accepted design, its loss, the rule's control, and how many
    refusals in a row there have been. Its fields are those of checkpoints."""

    model: Model
    loss: Float[Array, ""]
    control: Float[Array, ""]
    streak: Int[Array, ""]


class LeastSquares(Method):
    """A method for sums of squares: its tolerances and their norm, how it looks at the Jacobian, and by what rule it
    goes how far."""

    rtol: eqx.AbstractVar[float]
    atol: eqx.AbstractVar[float]
    norm: eqx.AbstractVar[Callable[[PyTree], Scalar]]
    jacobian: eqx.AbstractVar[str]
    products: eqx.AbstractVar[int]
    accuracy: eqx.AbstractVar[float]
    needs_gradient: ClassVar[bool] = False

    def __check_init__(self):
        name = type(self).__name__
        if not (self.rtol >= 0 and self.atol >= 0):
            raise ValueError(f"{name}: rtol and atol must not be negative; got {self.rtol} and {self.atol}.")
        if self.jacobian not in ("auto", "dense", "krylov"):
            raise ValueError(f"{name}: jacobian must be 'auto', 'dense' or 'krylov'; got {self.jacobian!r}.")
        if self.products != int(self.products) or self.products < 1:
            raise ValueError(f"{name}: products must be a whole number, at least 1; got {self.products}.")
        if not self.accuracy >= 0:
            raise ValueError(f"{name}: accuracy must not be negative; got {self.accuracy}.")

    @property
    @abc.abstractmethod
    def rule(self) -> Rule:
        """How far to go in the model."""

    def init(self, objective: Objective, variables: dict[str, Array]) -> Standing:
        """The state before the first step: a model that proposes to stay."""
        problem = objective.problem(variables)
        if not isinstance(problem, SquaresTrainable):
            raise ValueError(
                f"{type(self).__name__} needs the residuals of the loss: give {type(problem).__name__} a method "
                "residuals(equilibrium), or train it with an optax optimiser."
            )
        flat, _ = jax.flatten_util.ravel_pytree(variables)
        m = _count_residuals(objective.design, variables)
        model = Model.empty(self._products.plan(m, flat.size), m, flat.size, flat.dtype)
        return Standing(model, jnp.asarray(np.inf), jnp.asarray(np.nan), jnp.zeros((), jnp.int32))

    def accept(self, objective: Objective, found: Evaluation, course: Course) -> Accepted | None:
        """A design that lowers the loss by enough, with its gradient and its model."""
        loss = float(found.loss)
        if self._declines(course.state, loss, objective.rise):
            return None
        state = self._rated(course.state, loss)
        # Before the first step the damping is not known: the space is then made for a small one.
        damping = self.rule.damping(float(state.control)) if np.isfinite(state.control) else 0.0
        squares, gradient, norm, model = linearise(
            objective.design, found.free, found.equilibrium, jnp.asarray(damping), self._products
        )
        squares = float(squares)
        if not np.isfinite(state.loss) and abs(loss - squares) > _MISMATCH * max(abs(loss), abs(squares)):
            raise ValueError(
                f"the squares of the residuals sum to {squares:.9g}, but the loss is {loss:.9g}: residuals() and the "
                "loss of the problem must agree."
            )
        found = eqx.tree_at(
            lambda e: (e.gradient, e.gradient_norm), found, (gradient, norm), is_leaf=lambda x: x is None
        )
        state = eqx.tree_at(lambda s: (s.model, s.loss), state, (model, jnp.asarray(np.float64(loss))))
        return Accepted(found, state, {"control": float(course.state.control), "products": int(model.products)})

    def update(self, objective: Objective, found: Evaluation, state: Standing) -> tuple[dict[str, Array], Standing]:
        """The step that the rule takes in the model."""
        control = float(state.control)
        control = control if np.isfinite(control) else self.rule.begin(state.model)
        state = _with(state, control=control, streak=0)
        return self._step(state, found.free), state

    def refuse(self, course: Course) -> Course:
        """A shorter step in the same model."""
        state = course.state
        length, streak = float(np.linalg.norm(self._coefficients(state))), int(state.streak) + 1
        state = _with(state, control=self.rule.refused(float(state.control), length, streak), streak=streak)
        return course._replace(update=self._step(state, course.anchor), state=state)

    def arrived(self, course: Course) -> bool:
        """Whether the step and what the model hopes to gain by it are below the tolerances."""
        state = course.state
        if not np.isfinite(state.loss):
            return False
        y, step = (jax.flatten_util.ravel_pytree(tree)[0] for tree in (course.anchor, course.update))
        residual = np.linalg.norm(np.asarray(state.model.singular) * self._coefficients(state))
        near = self.norm(jnp.abs(step) / (self.atol + self.rtol * jnp.abs(y))) < 1
        return bool(near) and bool(residual < self.atol + self.rtol * np.sqrt(float(state.loss)))

    def _declines(self, state: Standing, loss: float, rise: float | None) -> bool:
        before = float(state.loss)
        if not np.isfinite(before):
            return False
        if rise is not None:
            return not loss <= before + rise * before
        promised = self._promised(state)
        # Where the loss has no digits left to fall by, a step that is small enough is let through once it is level.
        noise = _ROUNDING * abs(before)
        return not before - loss >= min(_SUFFICIENT * promised, promised - noise)

    def _rated(self, state: Standing, loss: float) -> Standing:
        """The state with its control after its step was accepted with this loss."""
        if not np.isfinite(state.loss):
            return state
        promised = self._promised(state)
        gain = (float(state.loss) - loss) / promised if promised > 0 else 0.0
        length = float(np.linalg.norm(self._coefficients(state)))
        return _with(state, control=self.rule.accepted(float(state.control), length, gain), streak=0)

    def _promised(self, state: Standing) -> float:
        return state.model.reduction(self._coefficients(state))

    def _coefficients(self, state: Standing) -> np.ndarray:
        return self.rule.step(state.model, float(state.control))

    def _step(self, state: Standing, like: dict[str, Array]) -> dict[str, Array]:
        return combine(state.model, jnp.asarray(self._coefficients(state)), like)

    @property
    def _products(self) -> Products:
        return Products(self.jacobian, self.products, self.accuracy)


class LevenbergMarquardt(LeastSquares):
    r"""Levenberg and Marquardt's method, for a loss that is a sum of squares: the first choice for second-order
    training.

    With residuals $r$ and their Jacobian $J$ in all that is trained, through the equilibrium, a step $p$ solves
    $(J^T J + \mu I)\,p = -J^T r$ and is taken if it lowers the loss. A trial design that is not accepted costs its
    relaxation and nothing more: the Jacobian was looked at once, at the last accepted design, in a way that gives the
    step for every damping.

    **Arguments:**

    - `rtol`, `atol`: the fit stops as `"converged"` when the next step $p$ of the trained $y$ has
        $|p| / (\text{atol} + \text{rtol}\,|y|) < 1$ in the norm, and likewise what it changes in the residuals.
    - `norm`: from a vector to a number; `optimistix.max_norm`, `rms_norm` or `two_norm`.
    - `jacobian`: `"dense"`: all of $J$, by as many sweeps with the factor of the Hessian as it has rows or columns;
        `"krylov"`: only its products, on the Krylov space of $J^T J$ and the gradient; `"auto"`: dense where $J$ has
        at most twice `products` rows or columns.
    - `products`: the largest number of pairs of products with $J$ and $J^T$ for a Krylov space.
    - `accuracy`: the space is made until the damped step leaves this part of the gradient.
    - `damping`: how $\mu$ begins and changes, a [`shellkit.NielsenDamping`][].

    **Raises:** `ValueError` for numbers out of range; by `fit`, for a loss that gives no residuals.

    When not to use it: where the loss cannot nearly vanish it converges as a good descent does, and it goes downhill
    only: [how to train to second order](../how-to/second-order.md).

    ??? cite "Sources"
        D. W. Marquardt, *An algorithm for least-squares estimation of nonlinear parameters*, J. SIAM 11 (1963)
        431–441; J. Nocedal, S. Wright, *Numerical Optimization*, 2nd edition (2006), section 10.3.
    """

    rtol: float = 1e-6
    atol: float = 1e-9
    norm: Callable[[PyTree], Scalar] = optx.max_norm
    jacobian: Literal["auto", "dense", "krylov"] = "auto"
    products: int = 100
    accuracy: float = 1e-2
    damping: NielsenDamping = NielsenDamping()

    @property
    def rule(self) -> NielsenDamping:
        return self.damping


class GaussNewton(LeastSquares):
    """Gauss and Newton's method: the undamped step, halved where it is refused. For residuals that fix all that is
    trained, such as a few parameters of a measured shape.

    **Arguments:**

    - `rtol`, `atol`, `norm`, `jacobian`, `products`, `accuracy`: as of [`shellkit.LevenbergMarquardt`][].

    **Raises:** `ValueError` for numbers out of range; by `fit`, for a loss that gives no residuals.

    When not to use it: where some combination of what is trained hardly changes the residuals, the undamped step is
    long and wild there. Take Levenberg and Marquardt's method.
    """

    rtol: float = 1e-6
    atol: float = 1e-9
    norm: Callable[[PyTree], Scalar] = optx.max_norm
    jacobian: Literal["auto", "dense", "krylov"] = "auto"
    products: int = 100
    accuracy: float = 1e-2

    @property
    def rule(self) -> StepHalving:
        return StepHalving()


class Dogleg(LeastSquares):
    """Powell's dogleg: from steepest descent towards the Gauss–Newton step, within a radius that follows the gain.

    **Arguments:**

    - `rtol`, `atol`, `norm`, `jacobian`, `products`, `accuracy`: as of [`shellkit.LevenbergMarquardt`][].

    **Raises:** `ValueError` for numbers out of range; by `fit`, for a loss that gives no residuals.

    When not to use it: Levenberg and Marquardt's steps are as cheap here and bend towards descent more smoothly.
    """

    rtol: float = 1e-6
    atol: float = 1e-9
    norm: Callable[[PyTree], Scalar] = optx.max_norm
    jacobian: Literal["auto", "dense", "krylov"] = "auto"
    products: int = 100
    accuracy: float = 1e-2

    @property
    def rule(self) -> DoglegRadius:
        return DoglegRadius()


@eqx.filter_jit
def linearise(
    design: Design, free: dict[str, Array], equilibrium: Any, damping: Float[Array, ""], products: Products
) -> tuple[Float[Array, ""], dict[str, Array], Float[Array, ""], Model]:
    """The sum of squares at a design and its equilibrium, its gradient and the norm of that, and its local model."""
    residuals, push, pull, flat, unravel = jacobian(design, free, equilibrium)
    plan = products.plan(residuals.size, flat.size)
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
