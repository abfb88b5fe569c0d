"""What the solvers of a sparse symmetric system have in common: factorise once, then solve as often as wanted.

They are lineax solvers. A Newton method uses the two steps apart: it reads the inertia off the factor before it trusts
it."""

from abc import abstractmethod
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..matrices.operator import SparseSymmetric, taken
from ..matrices.pattern import SymmetricPattern


class Factor(eqx.Module):
    """A factorised matrix, by reference: what names the factor in the library that holds it, and the matrix itself.

    Arrays only, so it can be carried through `jax.lax.while_loop`. The matrix, as the solver has scaled it, comes along
    because the library may drop or overwrite a factor; it is then made anew from here, never used wrongly.
    """

    pattern: SymmetricPattern
    values: Float[Array, "nnz"]
    token: PyTree[Array]
    negative: Int[Array, ""]
    """How many eigenvalues are negative; -1 if the solver cannot tell."""
    ok: Bool[Array, ""]
    """Whether the factorisation succeeded, with no pivot lost to rounding."""


class LastFactor(eqx.Module):
    """A factor without the pattern, which its user has: that with which a relaxation ended, of a Hessian near the
    minimum."""

    values: Float[Array, " nnz"]
    token: PyTree[Array]
    negative: Int[Array, ""]
    ok: Bool[Array, ""]

    @classmethod
    def of(cls, factor: Factor) -> "LastFactor":
        """What is kept of a factor."""
        return cls(factor.values, factor.token, factor.negative, factor.ok)

    def factor(self, pattern: SymmetricPattern) -> Factor:
        """The factor, for a matrix of this pattern."""
        return Factor(pattern, self.values, self.token, self.negative, self.ok)


class AbstractSparseSolver(lx.AbstractLinearSolver[Factor]):
    """A solver of systems with a [`SparseSymmetric`][] matrix, in two steps.

    Pass it to `lineax.linear_solve` for a differentiable solution; a factor at hand goes in as `state`. Or call
    `factorise` and `solve`, which carry no derivatives.
    """

    papers: ClassVar[tuple[str, ...]] = ()
    """What to cite for it, as BibTeX; see [`shellkit.InverseProblem.citation`][]."""

    @abstractmethod
    def factorise(self, operator: SparseSymmetric) -> Factor:
        """Prepares the matrix for solving. Whatever depends on its pattern alone is done once per process.

        **Returns:**

        A [`Factor`][], with the inertia and whether it can be relied on. A singular matrix is reported by `ok`, not
        raised.

        **Raises:**

        `ValueError` if the values are not float64.
        """

    @abstractmethod
    def factorise_and_solve(
        self, operator: SparseSymmetric, rhs: Float[Array, "n"]
    ) -> tuple[Factor, Float[Array, "n"]]:
        """Both at once, which some libraries do for less."""

    @abstractmethod
    def solve(self, factor: Factor, rhs: Float[Array, "*k n"], checked: bool = True) -> Float[Array, "*k n"]:
        """Solves for one right-hand side of shape (n,), or for k of them of shape (k, n) in one call.

        A caller that finds out by itself whether the solution is one, as iterations do, may leave `checked` out: where
        a library can mistake the factor of another matrix for this one, that saves a product.
        """

    def init(self, operator: lx.AbstractLinearOperator, options: dict[str, Any]) -> Factor:
        del options
        if not isinstance(operator, SparseSymmetric):
            raise ValueError(f"{type(self).__name__} needs a SparseSymmetric operator, not {type(operator).__name__}")
        return self.factorise(operator)

    def transpose(self, state: Factor, options: dict[str, Any]) -> tuple[Factor, dict[str, Any]]:
        return state, options

    def conj(self, state: Factor, options: dict[str, Any]) -> tuple[Factor, dict[str, Any]]:
        return state, options

    def assume_full_rank(self) -> bool:
        return True


class AbstractDirectSolver(AbstractSparseSolver):
    """A sparse solver whose factor gives the solution in one sweep."""

    def compute(
        self, state: Factor, vector: PyTree[Array], options: dict[str, Any]
    ) -> tuple[PyTree[Array], lx.RESULTS, dict[str, Any]]:
        del options
        flat, unravel = jax.flatten_util.ravel_pytree(vector)
        result = lx.RESULTS.where(state.ok, lx.RESULTS.successful, lx.RESULTS.singular)
        return unravel(self.solve(state, flat)), result, {}


def require_float64(solver: str, values: Array) -> None:
    """Refuses single precision, in which a stiff matrix keeps no digits."""
    if values.dtype != jnp.float64:
        raise ValueError(
            f"{solver} works on float64 matrices only, but the values are {values.dtype}: "
            'call jax.config.update("jax_enable_x64", True) before any array is made'
        )


def guarded(pattern: SymmetricPattern, values: Float[Array, "nnz"]) -> tuple[Float[Array, "nnz"], Bool[Array, ""]]:
    """The values, or an identity in their place if not all are finite, which the libraries would choke on; and if they
    are."""
    finite = jnp.all(jnp.isfinite(values))
    return identity_unless(finite, pattern, values), finite


def balanced(pattern: SymmetricPattern, values: Float[Array, "nnz"]) -> tuple[Float[Array, "nnz"], Float[Array, "n"]]:
    """The values with rows and columns scaled so that the diagonal is of ones, and those scales.

    Bending is 1e-10 of stretching in a thin shell: its pivots would be taken for rounding.
    """
    size = jnp.abs(taken(values, pattern.diagonal))
    scale = jnp.where(size > 0, jax.lax.rsqrt(jnp.where(size > 0, size, 1.0)), 1.0)
    return values * taken(scale, pattern.rows) * taken(scale, pattern.indices), scale


def identity_unless(
    usable: Bool[Array, ""], pattern: SymmetricPattern, values: Float[Array, "nnz"]
) -> Float[Array, "nnz"]:
    """The values where the matrix is usable, else those of the identity."""
    return jnp.where(usable, values, (pattern.rows == pattern.indices).astype(values.dtype))


def check_rhs(factor: Factor, rhs: Array) -> None:
    """Refuses right-hand sides that do not fit the factorised matrix."""
    n = factor.pattern.n
    if rhs.ndim not in (1, 2) or rhs.shape[-1] != n:
        raise ValueError(f"right-hand sides have shape {rhs.shape}: expected ({n},), or (k, {n}) for k of them")
