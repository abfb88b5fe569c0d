"""Corrections of a Newton step by its own factor, near a minimum."""

from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Scalar

from ..._citation.papers import NOCEDAL_2006
from .points import Point, Step


class Memory(eqx.Module):
    """Steps of the corrections so far and the changes of the gradient that they made, the latest last."""

    steps: Float[Array, "m n"]
    changes: Float[Array, "m n"]

    @classmethod
    def blank(cls, size: int, y: Float[Array, " n"]) -> "Memory":
        """A memory of nothing."""
        return cls(jnp.zeros((size, *y.shape), y.dtype), jnp.zeros((size, *y.shape), y.dtype))

    def with_one(self, step: Float[Array, " n"], change: Float[Array, " n"]) -> "Memory":
        """This with one more, in the place of the oldest."""
        return Memory(jnp.concatenate([self.steps[1:], step[None]]), jnp.concatenate([self.changes[1:], change[None]]))

    def direction(self, gradient: Float[Array, " n"], solve: Callable[[Array], Array]) -> Float[Array, " n"]:
        """The two-loop recursion of L-BFGS, with the inverse by the factor inside."""
        size = len(self.steps)
        curvatures = jnp.sum(self.steps * self.changes, axis=1)
        inverses = jnp.where(curvatures > 0, 1.0 / jnp.where(curvatures > 0, curvatures, 1.0), 0.0)

        def back(i: Int[Array, ""], carry: tuple[Array, Array]) -> tuple[Array, Array]:
            rest, weights = carry
            k = size - 1 - i
            weight = inverses[k] * (self.steps[k] @ rest)
            return rest - weight * self.changes[k], weights.at[k].set(weight)

        def forth(k: Int[Array, ""], direction: Float[Array, " n"]) -> Float[Array, " n"]:
            return direction + (weights[k] - inverses[k] * (self.changes[k] @ direction)) * self.steps[k]

        rest, weights = jax.lax.fori_loop(0, size, back, (gradient, jnp.zeros(size)))
        return -jax.lax.fori_loop(0, size, forth, solve(rest))


class Correction(eqx.Module):
    """How far the corrections of a step have come; before the first, where its search is."""

    direction: Float[Array, " n"]
    size: Scalar
    """The largest entry of the direction."""
    on: Bool[Array, ""]
    """The search has ended, and a correction is next."""
    settled: Bool[Array, ""]
    """The last one was within tolerance."""
    memory: Memory


class Corrections(eqx.Module):
    """Quasi-Newton steps with the factor of a Newton step that was taken in full, each at a fraction of its price: they
    go on while each makes the gradient much smaller, and until one is within tolerance.

    They pay for themselves where a factorisation costs several times as much as a gradient and a sweep.

    ??? cite "Source"
        Algorithm 7.4 (L-BFGS) of J. Nocedal and S. Wright, *Numerical Optimization*, 2nd edition (2006), begun from the
        factor in the place of a multiple of the identity.

    **Arguments:**

    - `contraction`: they go on while each cuts the gradient to this part or less,
    - `patience`: and while no more of them than this seem to be left.
    - `max_tries`: the most corrections of one step.
    - `memory`: how many of them the next one learns from.
    """

    papers: ClassVar[tuple[str, ...]] = (NOCEDAL_2006,)
    contraction: float = eqx.field(static=True, default=0.5)
    patience: float = eqx.field(static=True, default=8.0)  # a step costs as much as seven
    max_tries: int = eqx.field(static=True, default=24)
    memory: int = eqx.field(static=True, default=8)

    def begin(self, step: Step) -> Correction:
        """Before a step is searched along: none so far.

        **Arguments:**

        - `step`: the step.
        """
        no = jnp.array(False)
        return Correction(step.direction, step.size, no, no, Memory.blank(self.memory, step.start.y))

    def accepts(self, now: Point, trial: Point, ratio: Scalar, noise: Scalar) -> Bool[Array, ""]:
        """Whether a corrected point is better: the gradient decides.

        **Arguments:**

        - `now`, `trial`: where the correction begins, and where it leads.
        - `ratio`: of the norms of their gradients.
        - `noise`: the difference of energies that says nothing.
        """
        return (trial.value <= now.value + noise) & (ratio < 1)

    def pays(
        self, now: Correction, tries: Int[Array, ""], first: Bool[Array, ""], ratio: Scalar, target: Scalar
    ) -> Bool[Array, ""]:
        """Whether another one is worth its price.

        **Arguments:**

        - `now`: the last one, or, if there was none, the step itself.
        - `tries`: how many there were before.
        - `first`: whether the step itself is good enough to be corrected.
        - `ratio`: of the norms of the gradient after it and before.
        - `target`: the size of the last one that is needed.
        """
        left = jnp.log(now.size * ratio / target) / -jnp.log(ratio)
        converging = (ratio < self.contraction) & (left < self.patience)
        return jnp.where(now.on, converging, first) & (~now.on | (tries < self.max_tries))

    def after(
        self,
        now: Correction,
        gradients: tuple[Float[Array, " n"], Float[Array, " n"]],
        again: Bool[Array, ""],
        settled: Bool[Array, ""],
        solve: Callable[[Array], Array],
    ) -> Correction:
        """The next correction. The step of the search itself is not learnt from: it was long, and the curvature along
        it is not that here.

        **Arguments:**

        - `now`: the last one.
        - `gradients`: before and after it.
        - `again`: whether there is to be another.
        - `settled`: whether it was within tolerance.
        - `solve`: with the factor of the step.
        """

        def another() -> tuple[Memory, Array]:
            before, after = gradients
            learnt = now.memory.with_one(now.direction, after - before)
            memory = jax.tree.map(lambda new, old: jnp.where(now.on, new, old), learnt, now.memory)
            return memory, memory.direction(after, solve)

        memory, direction = jax.lax.cond(again, another, lambda: (now.memory, now.direction))
        return Correction(direction, jnp.max(jnp.abs(direction)), again, settled, memory)
