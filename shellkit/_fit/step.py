"""The compiled parts of a training step. They are functions of the module with everything as an argument, so that each
is compiled once for a kind of problem: a second fit with other values compiles nothing."""

import threading
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Scalar

from .._equilibrium import Equilibrium
from .._problem.problem import InverseProblem
from .._problem.states import Equilibria, States
from .._programs.compiling import FASTEST, program
from .._programs.tracing import known
from .._programs.waiting import announce
from .._relaxation.forward import relax
from .design import Design


_Struct = jax.ShapeDtypeStruct


class Evaluation(eqx.Module):
    """A design of a fit and what was found there.

    **Attributes:**

    - `free`: the design: arrays by name, in the optimiser's variables.
    - `values`: the trained arrays themselves, which differ from `free` where they are bounded.
    - `loss`, `terms`: the total loss, and the value of each of its terms by name, without its weight.
    - `gradient`, `gradient_norm`: the derivative of the loss in `free`, and its Euclidean norm; `None` where it was not
        asked for.
    - `equilibrium`: the relaxed shape, `None` if no loss term looks at it.
    - `diagnostics`: scalars of the relaxation by name, none where there was none.
    """

    free: dict[str, Array]
    values: dict[str, Array]
    loss: Scalar
    terms: dict[str, Scalar]
    gradient: dict[str, Array] | None
    gradient_norm: Scalar | None
    equilibrium: Any
    diagnostics: dict[str, Scalar]


def assess(design: Design, free: dict[str, Array], start: Any) -> Evaluation:
    """The loss at the optimiser's variables without its derivative, relaxed from an equilibrium or (`None`) from
    rest."""
    found = relaxation(design.problem(design.values(free)), start)
    return _assess(design, free, found, start if found is None else None)


def evaluate(design: Design, free: dict[str, Array], start: Any) -> Evaluation:
    """The loss and its derivative in the optimiser's variables, relaxed from an equilibrium or (`None`) from rest."""
    found = relaxation(design.problem(design.values(free)), start)
    return _evaluate(design, free, found, start if found is None else None)


def relaxation(problem: Any, start: Any) -> Any:
    """What the relaxation of a problem leaves, by the program that all share; `None` for a problem that has none of its
    own, or needs none."""
    return problem.relaxed(start) if relaxes_by_itself(problem) else None


def relaxes_by_itself(problem: Any) -> bool:
    """Whether the relaxation of a problem is a program of its own, and needed."""
    return isinstance(problem, InverseProblem | States) and problem.needs_shape


def objective(problem: Any, found: Any, start: Any) -> tuple[Any, tuple[dict[str, Any], Any]]:
    """What the method `objective` of a problem returns, at what `relaxation` found."""
    return problem.objective(start) if found is None else problem.respond(found)


def compile_ahead(design: Design, free: dict[str, Array]) -> None:
    """Compile the two programs of a gradient step at once: while one is compiled the other is traced. They are found
    compiled when they are called; nothing happens where they are already."""
    problem = design.problem(design.values(free))
    if isinstance(problem, InverseProblem) and problem.needs_shape:
        asked = problem.asked()
        compiling = threading.Thread(target=relax.lower(*asked).compile, daemon=True)
        compiling.start()
        try:
            blank = lambda leaf: known(np.zeros(leaf.shape, leaf.dtype)) if isinstance(leaf, _Struct) else leaf
            found = jax.tree.map(blank, eqx.filter_eval_shape(relax, *asked))
            _evaluate.lower(design, free, found, None).compile()
        finally:
            compiling.join()


@eqx.filter_jit
def _assess(design: Design, free: dict[str, Array], found: Any, start: Any) -> Evaluation:
    values = design.values(free)
    loss, (terms, equilibrium) = objective(design.problem(values), found, start)
    return Evaluation(free, values, loss, terms, None, None, equilibrium, _diagnostics(equilibrium))


@program(FASTEST)
def _evaluate(design: Design, free: dict[str, Array], found: Any, start: Any) -> Evaluation:
    announce("the gradient of this kind of loss")

    def loss_of(free):
        values = design.values(free)
        loss, (terms, equilibrium) = objective(design.problem(values), found, start)
        return loss, (values, terms, equilibrium)

    (loss, (values, terms, equilibrium)), gradient = eqx.filter_value_and_grad(loss_of, has_aux=True)(free)
    norm = jnp.sqrt(sum((jnp.vdot(g, g) for g in jax.tree.leaves(gradient)), jnp.zeros(())))
    return Evaluation(free, values, loss, terms, gradient, norm, equilibrium, _diagnostics(equilibrium))


@eqx.filter_jit
def advance(
    optimiser: Any,
    design: Design,
    found: tuple[dict[str, Array], Scalar, dict[str, Array]],
    state: Any,
    start: Any,
) -> tuple[dict[str, Array], Any]:
    """The optimiser's update and next state at a design, its loss and its gradient. A line search evaluates the loss
    itself; a relaxation that fails counts as infinitely bad there."""
    import optax

    free, loss, gradient = found

    def value_fn(free):
        value, (_, equilibrium) = design.problem(design.values(free)).objective(start=start)
        return value if equilibrium is None else jnp.where(equilibrium.converged, value, jnp.inf)

    with jax.numpy_dtype_promotion("standard"):  # optax mixes counts and rates
        update, state = optax.with_extra_args_support(optimiser).update(
            gradient, state, free, value=loss, grad=gradient, value_fn=value_fn
        )
    return strong(update), strong(state)


@eqx.filter_jit
def move(anchor: dict[str, Array], update: dict[str, Array], scale: Array) -> dict[str, Array]:
    """A design some part of an update away from another."""
    return jax.tree.map(lambda x, u: x + (scale * u).astype(x.dtype), anchor, update)


@eqx.filter_jit
def predict(design: Design, anchor: dict[str, Array], free: dict[str, Array], equilibrium: Any) -> Any:
    """The equilibrium of a design to first order, from the equilibrium of another: one solve with its Hessian."""

    def shape(free):
        problem = design.problem(design.values(free))
        if isinstance(problem, InverseProblem | States):
            return problem.near(equilibrium).unknowns
        _, (_, found) = problem.objective(start=equilibrium)
        return found.vertices, found.directors

    step = jax.tree.map(jnp.subtract, free, anchor)
    shape_there, motion = jax.jvp(shape, (anchor,), (step,))
    moved = jax.tree.map(jnp.add, shape_there, motion)
    if isinstance(equilibrium, Equilibrium | Equilibria):
        return equilibrium.with_unknowns(moved)
    return eqx.tree_at(lambda e: (e.vertices, e.directors), equilibrium, moved, is_leaf=lambda node: node is None)


def _diagnostics(equilibrium: Any) -> dict[str, Scalar]:
    if equilibrium is None:
        return {}
    return {
        "solver_steps": equilibrium.steps,
        "relaxation_gradient_norm": equilibrium.gradient_norm,
        "converged": equilibrium.converged,
        "stable": equilibrium.stable,
    }


def strong(tree: Any) -> Any:
    """The same arrays with dtypes of their own: one that only follows its neighbours' would compile a second time after
    a step, or after a restart."""
    return jax.tree.map(lambda x: jax.lax.convert_element_type(x, x.dtype) if _is_weak(x) else x, tree)


def _is_weak(leaf: Any) -> bool:
    return getattr(leaf, "weak_type", False)
