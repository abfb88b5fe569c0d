"""The way off a saddle."""

from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Scalar

from ..._citation.papers import KNYAZEV_2001
from .model import QuadraticModel
from .points import Reached, Step


Product = Callable[[Array], Array]


class SaddleEscape(eqx.Module):
    """A step off a saddle: along the softest direction of the convex model, by inverse iteration with its factor; or,
    where that is stable, along the lowest direction of the Hessian, if forces balance, or if the energy falls along it
    by more than it would rise along the softest.

    A shell buckles along its soft modes. What is unstable, but stiffer, while forces are out of balance is often stable
    where they lead, and ends in crumpled states. The step goes downhill; where both ways do, it is always the same
    one, so that problems that differ by little stay on one branch.

    It needs a [`shellkit.Shift`][], by which a saddle is known.

    ??? cite "Source"
        A. Knyazev, *Toward the optimal preconditioned eigensolver: locally optimal block preconditioned conjugate
        gradient method*, SIAM J. Sci. Comput. 23 (2001) 517–541, for one vector.

    **Arguments:**

    - `small`: steps below this fraction of the typical length, with a shift, may be at a saddle.
    - `balance`: forces below this part of what the softest step would raise are those of a saddle.
    - `slope`: along a direction of negative curvature, a slope below this part of it is rounding.
    - `dependent`: directions of length one that span no more than this are one.
    - `inverse_iterations`, `eigenvalue_steps`: how many steps find the softest direction, and then the lowest.
    """

    papers: ClassVar[tuple[str, ...]] = (KNYAZEV_2001,)
    small: float = eqx.field(static=True, default=1e-2)
    balance: float = eqx.field(static=True, default=1e-6)
    slope: float = eqx.field(static=True, default=1e-3)
    dependent: float = eqx.field(static=True, default=1e-12)
    inverse_iterations: int = eqx.field(static=True, default=8)
    eigenvalue_steps: int = eqx.field(static=True, default=16)

    def begins(self, model: QuadraticModel, step: Step, reached: Reached, unit: Scalar) -> Bool[Array, ""]:
        """Whether a step has ended at a saddle, so that the next one leads off it.

        **Arguments:**

        - `model`, `step`, `reached`: of the step that was taken, and where it led.
        - `unit`: the typical length.
        """
        # More than one try means that the matrix was just seen not to be definite.
        seen = (step.size < self.small * unit) & (model.tries > 1)
        return (model.shift > 0) & ~step.escaping & (reached.stalled | seen)

    def direction(
        self, product: Product, solve: Product, gradient: Float[Array, " n"], length: Scalar
    ) -> Float[Array, " n"]:
        """The step off a saddle.

        **Arguments:**

        - `product`: with the Hessian.
        - `solve`: with the matrix that was made convex and factorised.
        - `gradient`: where the step begins.
        - `length`: the largest entry of the step.
        """
        softest, lowest = self._soft_and_low(product, solve, _spread(gradient))
        # Both with their products by the Hessian.
        softest, lowest = (length / jnp.max(jnp.abs(way[0])) * way for way in (softest, lowest))
        rise, fall = softest[0] @ softest[1], -(lowest[0] @ lowest[1])
        balanced = jnp.linalg.norm(gradient) * jnp.linalg.norm(softest[0]) < self.balance * rise
        step, image = jnp.where((rise > 0) & (balanced | (fall > rise)), lowest, softest)
        uphill = gradient @ step > self.slope * jnp.maximum(-(step @ image), 0.0)
        return jnp.where(uphill, -step, step)

    def _soft_and_low(
        self, product: Product, solve: Product, start: Float[Array, " n"]
    ) -> tuple[Float[Array, "2 n"], Float[Array, "2 n"]]:
        """The softest direction of M, the matrix that `solve` solves with, and the lowest of v.Hv over v.Mv (of H alone
        it would be the shortest wave), each with its product by H. The latter is looked for only where the energy rises
        along the former.

        Inverse iterations come first, then steps of the locally optimal method from the same start. One loop does both,
        so that `solve` and `product` are compiled once.
        """

        def improve(now: _Iteration) -> _Iteration:
            vector, curved, weighed = now.kept[0]
            curvature = (vector @ curved) / (vector @ weighed)
            inverse = now.count <= self.inverse_iterations
            restart = jnp.where(now.count == self.inverse_iterations, start, vector)
            rhs = jnp.where(inverse, restart, curved - curvature * weighed)
            candidate = solve(rhs)
            trial = jnp.concatenate([now.kept, jnp.stack([candidate, product(candidate), rhs])[None]])
            sizes = jnp.abs(jnp.sum(trial[:, 0] * trial[:, 2], axis=1))
            trial = trial * jnp.where(sizes > 0, jax.lax.rsqrt(jnp.where(sizes > 0, sizes, 1.0)), 0.0)[:, None, None]
            newest = jnp.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
            kept = jnp.tensordot(jnp.where(inverse, newest, self._best_mixture(trial)), trial, 1)
            softest = jnp.where(now.count < self.inverse_iterations, kept[0, :2], now.softest)
            return _Iteration(now.count + 1, kept, softest, softest[0] @ softest[1])

        last = self.inverse_iterations + 1 + self.eigenvalue_steps

        def unfinished(now: _Iteration) -> Bool[Array, ""]:
            return (now.count < self.inverse_iterations) | ((now.count < last) & (now.rise > 0))

        blank = jnp.zeros_like(start)
        kept = jnp.stack([jnp.stack([start, blank, start]), jnp.stack([blank] * 3)])
        begin = _Iteration(jnp.zeros((), int), kept, jnp.stack([blank, blank]), jnp.zeros((), start.dtype))
        end = jax.lax.while_loop(unfinished, improve, begin)
        return end.softest, end.kept[0, :2]

    def _best_mixture(self, trial: Float[Array, "3 3 n"]) -> Float[Array, "2 3"]:
        """The weights of the lowest vector among three, and of the step that leads there from the first."""
        weights, axes = jnp.linalg.eigh(trial[:, 0] @ trial[:, 2].T)
        # A direction that is absent, or the same as the others, must not be the lowest.
        present = weights > self.dependent
        axes = axes * jnp.where(present, jax.lax.rsqrt(jnp.where(present, weights, 1.0)), 0.0)
        curvatures = axes.T @ (trial[:, 0] @ trial[:, 1].T) @ axes
        curvatures = 0.5 * (curvatures + curvatures.T)
        curvatures = curvatures + jnp.diag(jnp.where(present, 0.0, 1 + 2 * jnp.linalg.norm(curvatures)))
        mixture = axes @ jnp.linalg.eigh(curvatures)[1][:, 0]
        mixture = jnp.where(mixture[0] < 0, -mixture, mixture)  # which has either sign
        return jnp.stack([mixture, mixture.at[0].set(0.0)])


class _Iteration(eqx.Module):
    """Of the eigenvectors sought: the vector and the last step, each with its products by H and by M, as rows; and the
    softest direction so far with its product by H, and what that is."""

    count: Int[Array, ""]
    kept: Float[Array, "2 3 n"]
    softest: Float[Array, "2 n"]
    rise: Scalar


def _spread(like: Float[Array, " n"]) -> Float[Array, " n"]:
    """A vector with a part in every direction: the same each time, and cheaper to compile than random numbers."""
    return jnp.sin(jnp.arange(1.0, len(like) + 1.0, dtype=like.dtype) ** 2)
