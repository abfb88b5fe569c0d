"""The linear response of a minimum to its parameters, for many products at one design: the Hessian is factorised once,
at the minimum itself, and each product is then one sweep with that factor."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._programs.tracing import frozen
from .linear.base import AbstractSparseSolver
from .linear.bordered import BorderedSolver
from .null_space import gauged_hessian, pseudo_inverse_solve


def responding_minimum(
    energy: Any,
    y: Float[Array, " n"],
    motions: Callable[[Array], Array] | None,
    linear_solver: AbstractSparseSolver | BorderedSolver,
) -> Float[Array, " n"]:
    r"""The minimum `y` of `energy`, with its first derivative in the arrays of `energy`.

    $$y - H(y)^{+} \nabla E(y; \theta)$$

    with $y$ and $H$ not differentiated: a Newton step from the minimum, so it does not move, but its derivative is
    the implicit one. Under `jax.linearize` all but the sweep is done once, and the sweep's residual is not looked at,
    which makes it cheaper than `differentiable_minimum` when many products are wanted at one design. Second derivatives
    would be wrong.

    **Arguments:**

    - `energy`: a module with `gradient(y)` and a sparse `hessian(y)`.
    - `y`: where its gradient vanishes.
    - `motions`: `y -> ` motions that cost nothing, shape (n, k), or `None`.
    - `linear_solver`: of sparse symmetric systems. Products under `jax.vmap` are handed to it together.

    **Returns:**

    `y`, polished; NaN if the Hessian is singular there.
    """
    y = jax.lax.stop_gradient(y)
    hessian = frozen(energy).hessian(y)
    still, basis, _ = gauged_hessian(hessian, motions, y)
    factor = linear_solver.factorise(still)

    def solve(_, rhs):
        return pseudo_inverse_solve(linear_solver, factor, basis, rhs)

    correction = jax.lax.custom_linear_solve(hessian.mv, energy.gradient(y), solve, symmetric=True)
    # Not by a choice between both, whose derivative would be zero.
    return y - jnp.where(factor.ok, 1.0, jnp.nan) * correction
