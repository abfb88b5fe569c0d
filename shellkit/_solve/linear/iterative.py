"""Preconditioned conjugate gradients: for a GPU, or a platform without a direct solver, or a matrix near a factorised
one."""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..._citation.papers import HESTENES_1952
from ..matrices.operator import SparseSymmetric, symmetric_product
from .base import AbstractDirectSolver, AbstractSparseSolver, Factor, check_rhs, require_float64


class Descent(eqx.Module):
    """How a run of conjugate gradients ended."""

    solution: Float[Array, "n"]
    """The last iterate; where the curvature was negative, the one before that was met."""
    direction: Float[Array, "n"]
    """The last search direction $p$; where the curvature was negative, $p \\cdot A p \\le 0$."""
    negative: Bool[Array, ""]
    converged: Bool[Array, ""]
    steps: Int[Array, ""]


class ConjugateGradients(AbstractSparseSolver):
    """Conjugate gradients, preconditioned by the inverse diagonal blocks of the matrix or by the factor of a nearby
    one.

    For positive definite matrices. Slow on thin shells, whose condition numbers are large: a direct solver, where there
    is one, is faster at every size that was measured. `factorise` only inverts the blocks: its `negative` is 1 if a
    block is not positive definite (then neither is the matrix) and -1, unknown, otherwise; `descend` meets negative
    curvature.

    ??? cite "Reference"
        M. R. Hestenes, E. Stiefel, *Methods of conjugate gradients for solving linear systems*, Journal of Research of
        the National Bureau of Standards 49 (1952) 409–436.
    """

    papers: ClassVar[tuple[str, ...]] = (HESTENES_1952,)
    rtol: float = 1e-10
    """Converged when the residual is below this much of the right-hand side, in the Euclidean norm."""
    atol: float = 0.0
    """Or below this, in the unit of the right-hand side."""
    max_steps: int | None = eqx.field(static=True, default=None)
    """$2n$ if `None`."""
    block: int = eqx.field(static=True, default=3)
    """Size of the diagonal blocks: the number of unknowns a vertex has."""
    direct: AbstractDirectSolver | None = None
    """The direct solver whose factors are passed to `factorise` as `stale`."""

    def factorise(self, operator: SparseSymmetric, stale: Factor | None = None) -> Factor:
        """Inverts the diagonal blocks; or, given the `stale` factor of an older and positive definite matrix, takes
        that."""
        require_float64("ConjugateGradients", operator.values)
        values = jax.lax.stop_gradient(operator.values)
        finite = jnp.all(jnp.isfinite(values))
        if stale is not None:
            if self.direct is None:
                raise ValueError("a stale factor needs the solver that made it: ConjugateGradients(direct=...)")
            return Factor(operator.pattern, values, stale, jnp.asarray(-1), finite & stale.ok & (stale.negative == 0))
        inverses, definite = _block_inverses(operator.pattern, values, self.block)
        return Factor(operator.pattern, values, inverses, jnp.where(definite, -1, 1), finite)

    def factorise_and_solve(
        self, operator: SparseSymmetric, rhs: Float[Array, "n"]
    ) -> tuple[Factor, Float[Array, "n"]]:
        """The factor then also says whether negative curvature was met on the way to the solution."""
        factor = self.factorise(operator)
        end = self.descend(factor, rhs)
        negative = jnp.where(end.negative, 1, factor.negative)
        return eqx.tree_at(lambda f: f.negative, factor, negative), end.solution

    def solve(self, factor: Factor, rhs: Float[Array, "*k n"], checked: bool = True) -> Float[Array, "*k n"]:
        """Solves for one right-hand side or for several. Use `descend` to know whether and how far it converged."""
        check_rhs(factor, rhs)
        if rhs.ndim == 2:
            return jax.vmap(lambda each: self.descend(factor, each).solution)(rhs)
        return self.descend(factor, rhs).solution

    def descend(self, factor: Factor, rhs: Float[Array, "n"]) -> Descent:
        """Runs until the residual is small, the steps are used up, or a direction of negative curvature is met."""
        rhs = jax.lax.stop_gradient(rhs)
        limit = 2 * factor.pattern.n if self.max_steps is None else self.max_steps
        target = jnp.maximum(self.rtol * jnp.linalg.norm(rhs), self.atol)

        def unfinished(state):
            _, residual, _, _, negative, step = state
            return (jnp.linalg.norm(residual) > target) & ~negative & (step < limit)

        def advance(state):
            solution, residual, direction, decrease, _, step = state
            image = symmetric_product(factor.pattern, factor.values, direction)
            curvature = direction @ image
            negative = ~(curvature > 0)
            length = jnp.where(negative, 0.0, decrease / jnp.where(negative, 1.0, curvature))
            solution = solution + length * direction
            residual = residual - length * image
            steepest = self._precondition(factor, residual)
            next_decrease = residual @ steepest
            ahead = steepest + next_decrease / decrease * direction
            direction = jnp.where(negative, direction, ahead)
            return solution, residual, direction, next_decrease, negative, step + 1

        first = self._precondition(factor, rhs)
        start = (jnp.zeros_like(rhs), rhs, first, rhs @ first, jnp.asarray(False), jnp.asarray(0))
        solution, residual, direction, _, negative, steps = jax.lax.while_loop(unfinished, advance, start)
        return Descent(solution, direction, negative, jnp.linalg.norm(residual) <= target, steps)

    def compute(
        self, state: Factor, vector: PyTree[Array], options: dict[str, Any]
    ) -> tuple[PyTree[Array], lx.RESULTS, dict[str, Any]]:
        del options
        flat, unravel = jax.flatten_util.ravel_pytree(vector)
        end = self.descend(state, flat)
        failure = lx.RESULTS.where(end.negative, lx.RESULTS.breakdown, lx.RESULTS.max_steps_reached)
        result = lx.RESULTS.where(end.converged, lx.RESULTS.successful, failure)
        return unravel(end.solution), result, {"num_steps": end.steps, "negative": end.negative}

    def _precondition(self, factor: Factor, residual: Float[Array, "n"]) -> Float[Array, "n"]:
        if self.direct is not None and isinstance(factor.token, Factor):
            return self.direct.solve(factor.token, residual)
        blocks, block, _ = factor.token.shape
        padded = jnp.pad(residual, (0, blocks * block - residual.shape[0])).reshape(blocks, block)
        return jnp.einsum("bij,bj->bi", factor.token, padded).reshape(-1)[: residual.shape[0]]


def _block_inverses(pattern, values, block: int) -> tuple[Float[Array, "blocks block block"], Bool[Array, ""]]:
    """The inverse diagonal blocks with negative eigenvalues turned positive, and whether there were none."""
    blocks = -(-pattern.n // block)
    rows, columns = pattern.rows, pattern.indices
    home = jnp.where(rows // block == columns // block, rows // block, blocks)
    upper = jnp.zeros((blocks, block, block), values.dtype)
    upper = upper.at[home, rows % block, columns % block].set(values, mode="drop")
    matrices = upper + jnp.swapaxes(jnp.triu(upper, 1), 1, 2)
    beyond = jnp.arange(blocks * block).reshape(blocks, block) >= pattern.n
    matrices = matrices + jnp.where(beyond, 1.0, 0.0)[:, :, None] * jnp.eye(block)
    eigenvalues, vectors = jnp.linalg.eigh(jnp.where(jnp.isfinite(matrices), matrices, 0.0))
    floor = jnp.finfo(values.dtype).eps * jnp.max(jnp.abs(eigenvalues))
    magnitudes = jnp.maximum(jnp.abs(eigenvalues), jnp.where(floor > 0, floor, 1.0))
    return jnp.einsum("bij,bj,bkj->bik", vectors, 1 / magnitudes, vectors), jnp.all(eigenvalues > 0)
