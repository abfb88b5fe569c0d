"""The derivative of a minimum in the parameters of its energy, by the implicit function theorem."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .bordered import Bordered, BorderedSolver
from .direct import AbstractSparseSolver
from .motions import held_still, project_out
from .newton import solve_held


_RESIDUAL = 1e-13  # at which the solution of the adjoint system is taken as exact
_WORST_RESIDUAL = 1e-9  # above which it is not a solution
_MAX_STEPS = 20


def differentiable_minimum(
    energy: Any,
    y: Float[Array, " n"],
    motions: Callable[[Array], Array] | None,
    linear_solver: AbstractSparseSolver | BorderedSolver,
) -> Float[Array, " n"]:
    r"""The minimum `y` of `energy`, with the derivative that it has as a function of the arrays in `energy`.

    $$\mathrm d y = -H(y)^{+}\, \partial_\theta \nabla E(y; \theta)\, \mathrm d\theta,$$

    one solve, with the pseudo-inverse where some motions cost nothing. It can be differentiated forwards, backwards,
    and again.

    **Arguments:**

    - `energy`: a module with `gradient(y)` and a sparse `hessian(y)`.
    - `y`: where its gradient vanishes. Only as exact as that is the derivative.
    - `motions`: `y -> ` motions that cost nothing, shape (n, k), or `None`.
    - `linear_solver`: of sparse symmetric systems.

    **Returns:**

    `y`. Its derivatives are NaN where the linear system could not be solved, as for a singular Hessian: never a wrong
    number.
    """
    return _minimum(energy, jax.lax.stop_gradient(y), motions, linear_solver)


@eqx.filter_custom_jvp
def _minimum(energy, y, motions, linear_solver):
    return y


@_minimum.def_jvp
def _(primals, tangents):
    energy, _, motions, linear_solver = primals
    tangent = tangents[0]
    still, moving = eqx.partition(energy, jax.tree.map(_is_none, tangent, is_leaf=_is_none), is_leaf=_is_none)
    # The minimum itself again, not y: so that this rule can be differentiated in its turn.
    minimum = _minimum(*primals)
    force = jax.jvp(lambda e: eqx.combine(e, still).gradient(minimum), (moving,), (tangent,))[1]
    return minimum, -_solve(energy, minimum, force, motions, linear_solver)


def _is_none(leaf: Any) -> bool:
    return leaf is None


def _solve(energy, y, force, motions, linear_solver) -> Float[Array, " n"]:
    """H(y)^+ force, linear in the force; the Hessian enters through its products, so the result can be differentiated
    again."""
    product = lambda direction: jax.jvp(energy.gradient, (y,), (direction,))[1]
    there = jax.lax.stop_gradient(y)
    # A factor of this very Hessian: with Newton's last, which is of a point before, ten steps were needed where two do.
    hessian = _stop(energy).hessian(there)
    still, basis, held = held_still(hessian, motions, there)
    factor = linear_solver.factorise(still)

    def solve(_, rhs):
        precondition = lambda residual: solve_held(linear_solver, factor, basis, held, residual, checked=False)
        # With multipliers the matrix is indefinite, where conjugate gradients may break down.
        iterate = _refinement if isinstance(hessian, Bordered) else _conjugate_gradients
        return iterate(hessian.mv, precondition, project_out(basis, rhs))

    return jax.lax.custom_linear_solve(product, force, solve, symmetric=True)


def _stop(tree):
    return jax.tree.map(lambda leaf: jax.lax.stop_gradient(leaf) if eqx.is_inexact_array(leaf) else leaf, tree)


def _conjugate_gradients(product, precondition, rhs: Float[Array, " n"]) -> Float[Array, " n"]:
    """Solve with a preconditioner that is nearly the inverse: a step or two, or NaN if it does not get there."""
    scale = jnp.linalg.norm(rhs)

    def step(carry):
        x, residual, z, direction, norm, _, count = carry
        image = product(direction)
        rho = residual @ z
        length = rho / (direction @ image)
        x, residual = x + length * direction, residual - length * image
        size = jnp.linalg.norm(residual)
        # The last residual needs no sweep of its own.
        new = jax.lax.cond(size > _RESIDUAL * scale, precondition, lambda residual: residual, residual)
        # Polak and Ribière's form, for a preconditioner that is not exactly symmetric.
        beta = length * (-new @ image) / rho
        return x, residual, new, new + beta * direction, size, norm, count + 1

    def unsolved(carry):
        *_, norm, last, count = carry
        return (norm > _RESIDUAL * scale) & (norm < 0.5 * last) & (count < _MAX_STEPS)

    z = precondition(rhs)
    start = (jnp.zeros_like(rhs), rhs, z, z, scale, jnp.inf, 0)
    x, *_, norm, _, _ = jax.lax.while_loop(unsolved, step, start)
    return jnp.where(norm <= _WORST_RESIDUAL * scale, x, jnp.nan)


def _refinement(product, precondition, rhs: Float[Array, " n"]) -> Float[Array, " n"]:
    """Solve with what is nearly the inverse of any matrix, by taking its residuals away: a step or two, or NaN."""
    scale = jnp.linalg.norm(rhs)

    def step(carry):
        x, residual, norm, _, count = carry
        new = x + precondition(residual)
        left = rhs - product(new)
        size = jnp.linalg.norm(left)
        better = size < norm
        return jnp.where(better, new, x), jnp.where(better, left, residual), jnp.minimum(size, norm), norm, count + 1

    def unsolved(carry):
        *_, norm, last, count = carry
        return (norm > _RESIDUAL * scale) & (norm < 0.5 * last) & (count < _MAX_STEPS)

    start = (jnp.zeros_like(rhs), rhs, scale, jnp.inf, 0)
    x, _, norm, _, _ = jax.lax.while_loop(unsolved, step, start)
    return jnp.where(norm <= _WORST_RESIDUAL * scale, x, jnp.nan)
