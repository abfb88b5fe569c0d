"""The derivative of a minimum in the parameters of its energy, by the implicit function theorem."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._programs.tracing import frozen
from .linear.base import AbstractDirectSolver, AbstractSparseSolver, LastFactor
from .linear.bordered import Bordered, BorderedSolver
from .matrices.pattern import SymmetricPattern
from .null_space import gauged_hessian, project_out, pseudo_inverse_solve


_RESIDUAL = 1e-13  # at which the solution of the adjoint system is taken as exact
_ERROR = 1e-12  # or at this error in the norm of the energy, both relative
_WORST_FIRST = 3e-5  # of a direct solver's first solution, which one correction then squares
_WORST_RESIDUAL = 1e-9  # above which it is not a solution
_MAX_STEPS = 20
MANY = 3000  # unknowns from which a factorisation costs more than the sweeps with an older one


Motions = Callable[[Array], Array]
Product = Callable[[Array], Array]
Solver = AbstractSparseSolver | BorderedSolver
Last = tuple[LastFactor, SymmetricPattern]


def differentiable_minimum(
    energy: Any,
    y: Float[Array, " n"],
    motions: Motions | None,
    linear_solver: Solver,
    last: Last | None = None,
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
    - `last`: a factor by this solver to try first, where the system is large, and its pattern.

    **Returns:**

    `y`. Its derivatives are NaN where the linear system could not be solved, as for a singular Hessian: never a wrong
    number.
    """
    direct = isinstance(linear_solver, AbstractDirectSolver) and len(y) >= MANY
    return _minimum(energy, jax.lax.stop_gradient(y), motions, linear_solver, frozen(last) if direct else None)


@eqx.filter_custom_jvp
def _minimum(
    energy: Any, y: Float[Array, " n"], motions: Motions | None, linear_solver: Solver, last: Last | None
) -> Float[Array, " n"]:
    return y


@_minimum.def_jvp
def _(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    energy, _, motions, linear_solver, last = primals
    tangent = tangents[0]
    still, moving = eqx.partition(energy, jax.tree.map(_is_none, tangent, is_leaf=_is_none), is_leaf=_is_none)
    # The minimum itself again, not y: so that this rule can be differentiated in its turn.
    minimum = _minimum(*primals)
    force = jax.jvp(lambda e: eqx.combine(e, still).gradient(minimum), (moving,), (tangent,))[1]
    return minimum, -_solve(energy, minimum, force, motions, linear_solver, last)


def _is_none(leaf: Any) -> bool:
    return leaf is None


def _solve(
    energy: Any,
    y: Float[Array, " n"],
    force: Float[Array, " n"],
    motions: Motions | None,
    linear_solver: Solver,
    last: Last | None,
) -> Float[Array, " n"]:
    """H(y)^+ force, linear in the force; the Hessian enters through its products, so the result can be differentiated
    again."""
    product = lambda direction: jax.jvp(energy.gradient, (y,), (direction,))[1]
    there = jax.lax.stop_gradient(y)
    hessian = frozen(energy).hessian(there)
    still, basis, _ = gauged_hessian(hessian, motions, there)

    def anew(rhs: Float[Array, " n"]) -> Float[Array, " n"]:
        """With a factor of this very Hessian, in a step or two."""
        factor, first = linear_solver.factorise_and_solve(still, rhs)
        first = project_out(basis, first)
        precondition = lambda residual: pseudo_inverse_solve(linear_solver, factor, basis, residual, checked=False)
        if isinstance(linear_solver, AbstractDirectSolver):
            # What its solution leaves is a few roundings; taken away once more, those of the matrix are left.
            left = project_out(basis, rhs - hessian.mv(first))
            solved = jnp.linalg.norm(left) <= _WORST_FIRST * jnp.linalg.norm(rhs)
            return jnp.where(solved, first + precondition(left), jnp.nan)
        # With multipliers the matrix is indefinite, where conjugate gradients may break down.
        iterate = _refinement if isinstance(hessian, Bordered) else _conjugate_gradients
        return iterate(hessian.mv, precondition, rhs, first, _MAX_STEPS).checked()

    def with_last(last: Last, rhs: Float[Array, " n"]) -> Float[Array, " n"]:
        """With the last one, unless that takes longer."""
        left, pattern = last
        factor = left.factor(pattern)
        precondition = lambda residual: pseudo_inverse_solve(linear_solver, factor, basis, residual, checked=False)
        found = _conjugate_gradients(hessian.mv, precondition, rhs, precondition(rhs), _patience(len(rhs)))
        return jax.lax.cond(found.solved, lambda: found.x, lambda: anew(rhs))

    solve = anew if last is None else functools.partial(with_last, last)
    return jax.lax.custom_linear_solve(product, force, lambda _, b: solve(project_out(basis, b)), symmetric=True)


def _patience(n: int) -> int:
    """How many sweeps, with their products, cost as much as a factorisation. For Hessians of shells in PARDISO it was
    five at 2000 unknowns, seven at 4000 to 8000, and thirteen at 31,000."""
    return round(n**0.4 / 4)


class _Iterate(NamedTuple):
    """Where an iteration has come to: the solution, the norms of its residual and of the right-hand side, and whether
    it is solved."""

    x: Float[Array, " n"]
    norm: Float[Array, ""]
    scale: Float[Array, ""]
    solved: Bool[Array, ""]

    def checked(self) -> Float[Array, " n"]:
        """The solution, or NaN if it is none."""
        return jnp.where(self.solved | (self.norm <= _WORST_RESIDUAL * self.scale), self.x, jnp.nan)


def _conjugate_gradients(
    product: Product, precondition: Product, rhs: Float[Array, " n"], first: Float[Array, " n"], max_steps: int
) -> _Iterate:
    """Solve with a preconditioner that is nearly the inverse, `first` being what it makes of the right-hand side; as
    long as no more than `max_steps` steps seem to be needed."""
    scale = jnp.linalg.norm(rhs)

    def step(carry: tuple[Any, ...]) -> tuple[Any, ...]:
        x, residual, z, direction, norm, _, total, last, _, count = carry
        image = product(direction)
        rho = residual @ z
        length = rho / (direction @ image)
        x, residual = x + length * direction, residual - length * image
        size = jnp.linalg.norm(residual)
        # The square of the step, in the norm of the energy, is what it took off the square of the error.
        gone = jnp.abs(length * rho)
        total = total + gone
        # What is left goes by the same factor, or faster.
        ratio = jnp.where(count > 0, jnp.sqrt(gone / last), size / norm)
        error = ratio * jnp.sqrt(gone / total)
        solved = (size <= _RESIDUAL * scale) | ((error <= _ERROR) & (size <= _WORST_RESIDUAL * scale))
        # A first step says little about those to come.
        ahead = jnp.where(count > 0, jnp.log(error / _ERROR) / -jnp.log(ratio), 0.0)
        hopeful = (size < 0.5 * norm) & ~(count + ahead >= max_steps)
        # The last residual needs no sweep of its own.
        new = jax.lax.cond(solved | ~hopeful, lambda residual: residual, precondition, residual)
        # Polak and Ribière's form, for a preconditioner that is not exactly symmetric.
        beta = length * (-new @ image) / rho
        return x, residual, new, new + beta * direction, size, hopeful, total, gone, solved, count + 1

    def unsolved(carry: tuple[Any, ...]) -> Bool[Array, ""]:
        *_, hopeful, _, _, solved, count = carry
        return ~solved & hopeful & (count < max_steps)

    zero = jnp.zeros(())
    start = (jnp.zeros_like(rhs), rhs, first, first, scale, scale > 0, zero, jnp.inf, scale == 0, 0)
    x, _, _, _, norm, _, _, _, solved, _ = jax.lax.while_loop(unsolved, step, start)
    return _Iterate(x, norm, scale, solved)


def _refinement(
    product: Product, precondition: Product, rhs: Float[Array, " n"], first: Float[Array, " n"], max_steps: int
) -> _Iterate:
    """Solve with what is nearly the inverse of any matrix, by taking its residuals away; see `_conjugate_gradients`."""
    scale = jnp.linalg.norm(rhs)

    def step(carry: tuple[Any, ...]) -> tuple[Any, ...]:
        x, residual, norm, _, count = carry
        new = x + jax.lax.cond(count > 0, precondition, lambda _: first, residual)
        left = rhs - product(new)
        size = jnp.linalg.norm(left)
        better = size < norm
        return jnp.where(better, new, x), jnp.where(better, left, residual), jnp.minimum(size, norm), norm, count + 1

    def unsolved(carry: tuple[Any, ...]) -> Bool[Array, ""]:
        *_, norm, last, count = carry
        return (norm > _RESIDUAL * scale) & (norm < 0.5 * last) & (count < max_steps)

    start = (jnp.zeros_like(rhs), rhs, scale, jnp.inf, 0)
    x, _, norm, _, _ = jax.lax.while_loop(unsolved, step, start)
    return _Iterate(x, norm, scale, norm <= _RESIDUAL * scale)
