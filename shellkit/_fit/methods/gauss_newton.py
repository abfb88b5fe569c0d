"""The local model of a sum of squares and the steps that follow from it. A model holds the leading part of the singular
value decomposition of the Jacobian, so that a step for another damping costs no further product with it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int


_BATCH = 32  # products that are asked for at once where the Jacobian is made dense
_EXHAUSTED = 1e-14  # relative size at which a new direction of the Krylov space is rounding


class Plan(NamedTuple):
    """How the Jacobian is looked at: `dense`, in full, or by at most `products` pairs of products, fewer if the
    gradient left over is below the fraction `tolerance` of what it was."""

    dense: bool
    products: int
    tolerance: float


class Products(NamedTuple):
    """How a method wants the Jacobian to be looked at: `"dense"`, `"krylov"`, or `"auto"`, in full where the directions
    of both ways would be about as many."""

    kind: str
    most: int
    tolerance: float

    def plan(self, m: int, n: int) -> Plan:
        """The way to look at a Jacobian of m rows and n columns."""
        if self.kind == "dense" or (self.kind == "auto" and min(m, n) <= 2 * self.most):
            return Plan(True, min(m, n), 0.0)
        return Plan(False, self.most, self.tolerance)


class Model(eqx.Module):
    r"""The sum of squares $|r + J p|^2$ on the space spanned by some orthonormal directions $w_i$.

    There $|r + J \sum_i a_i w_i|^2 = \text{const} + \sum_i (\sigma_i a_i - c_i)^2$.
    """

    directions: Float[Array, "k n"]
    singular: Float[Array, " k"]
    along: Float[Array, " k"]
    products: Int[Array, ""]
    """How many pairs of products with the Jacobian and its transpose it took."""

    @classmethod
    def empty(cls, plan: Plan, m: int, n: int, dtype: Any) -> "Model":
        """A model that proposes to stay."""
        k = min(m, n) if plan.dense else min(plan.products, m, n)
        zero = jnp.zeros(k, dtype)
        return cls(jnp.zeros((k, n), dtype), zero, zero, jnp.zeros((), jnp.int32))

    def reduction(self, coefficients: np.ndarray) -> float:
        """By how much the model falls along a step."""
        along = np.asarray(self.along)
        return float(np.sum(along**2) - np.sum((along - np.asarray(self.singular) * coefficients) ** 2))


def dense_model(
    push: Callable[[Array], Array], pull: Callable[[Array], Array], residuals: Float[Array, " m"], n: int
) -> tuple[Float[Array, " n"], Model]:
    """Half the gradient, and the model on the whole space, from the Jacobian itself, made by columns or by rows."""
    m = residuals.shape[0]
    rows = min(_BATCH, m, n)
    if n <= m:
        # Products come as rows, so the transposed Jacobian; its triangle keeps the singular values.
        transposed = jax.lax.map(push, jnp.eye(n, dtype=residuals.dtype), batch_size=rows)
        q, r = jnp.linalg.qr(transposed.T)
        left, singular, right = jnp.linalg.svd(r, full_matrices=False)
        along = -(residuals @ q) @ left
        slope = transposed @ residuals
    else:
        jacobian = jax.lax.map(pull, jnp.eye(m, dtype=residuals.dtype), batch_size=rows)
        left, singular, right = jnp.linalg.svd(jacobian, full_matrices=False)
        along = -residuals @ left
        slope = residuals @ jacobian
    return slope, Model(right, singular, along, jnp.asarray(min(m, n), jnp.int32))


def krylov_model(
    push: Callable[[Array], Array],
    pull: Callable[[Array], Array],
    residuals: Float[Array, " m"],
    n: int,
    plan: Plan,
    damping: Float[Array, ""],
) -> tuple[Float[Array, " n"], Model]:
    """Half the gradient, and the model on the Krylov space of JᵀJ and the gradient, by Golub and Kahan's
    bidiagonalisation.

    It stops when the damped step is known well enough; the space does not depend on the damping, so that steps for
    others come from it as well.

    ??? cite "Sources"
        G. Golub, W. Kahan, *Calculating the singular values and pseudo-inverse of a matrix*, SIAM J. Numer. Anal. 2
        (1965) 205–224; stopping as in C. C. Paige, M. A. Saunders, *LSQR*, ACM TOMS 8 (1982) 43–71; one space for all
        dampings after Y. Lin, D. O'Malley, V. V. Vesselinov, Water Resour. Res. 52 (2016) 6948–6977.
    """
    k = min(plan.products, residuals.shape[0], n)
    dtype = residuals.dtype
    size = jnp.linalg.norm(residuals)
    u = -residuals / jnp.where(size > 0, size, 1)
    v = pull(u)
    alpha = jnp.linalg.norm(v)
    v = v / jnp.where(alpha > 0, alpha, 1)
    slope = -alpha * size * v

    def unfinished(carry):
        i, *_, left, _ = carry
        return (i < k) & (left > plan.tolerance * alpha * size)

    def extend(carry):
        i, u, v, alpha_i, basis, alphas, betas, rho_bar, phi_bar, _, largest = carry
        basis, alphas = basis.at[i].set(v), alphas.at[i].set(alpha_i)
        u = push(v) - alpha_i * u
        beta = jnp.linalg.norm(u)
        u = u / jnp.where(beta > 0, beta, 1)
        v_next = pull(u) - beta * v
        # Twice is enough: the directions stay orthogonal to rounding.
        for _ in range(2):
            v_next = v_next - (basis @ v_next) @ basis
        alpha_next = jnp.linalg.norm(v_next)
        largest = jnp.maximum(largest, jnp.maximum(alpha_i, beta))
        fresh = alpha_next > _EXHAUSTED * largest
        v_next = v_next / jnp.where(fresh, alpha_next, 1)
        alpha_next = jnp.where(fresh, alpha_next, 0)
        # The rotations of LSQR, for the norm of the gradient that the damped step leaves.
        damped = jnp.sqrt(rho_bar**2 + damping)
        phi_bar = phi_bar * rho_bar / jnp.where(damped > 0, damped, 1)
        rho = jnp.hypot(damped, beta)
        cosine, sine = damped / jnp.where(rho > 0, rho, 1), beta / jnp.where(rho > 0, rho, 1)
        left = alpha_next * jnp.abs(sine * cosine * phi_bar)
        betas = betas.at[i].set(beta)
        return i + 1, u, v_next, alpha_next, basis, alphas, betas, -cosine * alpha_next, sine * phi_bar, left, largest

    zero = jnp.zeros(k, dtype)
    start = (0, u, v, alpha, jnp.zeros((k, n), dtype), zero, zero, alpha, size, jnp.asarray(jnp.inf, dtype), alpha)
    count, *_, basis, alphas, betas, _, _, _, _ = jax.lax.while_loop(unfinished, extend, start)
    place = jnp.arange(k)
    bidiagonal = jnp.zeros((k + 1, k), dtype).at[place, place].set(alphas).at[place + 1, place].set(betas)
    left, singular, right = jnp.linalg.svd(bidiagonal, full_matrices=False)
    return slope, Model(right @ basis, singular, size * left[0], jnp.asarray(count, jnp.int32))
