"""Which arrays of a problem are trained, by which names, and within which bounds. A `Design` splits a problem into
the variables an optimiser moves and the rest, which is neither differentiated nor copied."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, PyTree

from .._problem.selection import name_of, selected


@dataclass(frozen=True)
class Bounds:
    r"""Keeps a trained array strictly between two limits, by a smooth change of variables.

    The optimiser moves a free variable $u$ instead of the array $x$,

    $$x = m + r \tanh\frac{u - m}{r}, \qquad m = \tfrac12(x_\text{low} + x_\text{high}), \quad
    r = \tfrac12(x_\text{high} - x_\text{low}).$$

    In the middle $u = x$ with slope one, so a learning rate means there what it means without bounds; near a limit the
    slope goes to zero. An optimum that lies *on* a limit is therefore approached ever more slowly: choose limits a
    little wider than where the design may end. `gradient_norm` in the history is with respect to $u$.

    **Arguments:**

    - `where`: a function from the problem to the array or arrays (a tuple, or any pytree) to bound. Each must be
        trained.
    - `low`, `high`: the limits, scalars or of a shape that broadcasts against each array. Units of the array.

    **Raises:** (by [`shellkit.fit`][]) `ValueError` if `low < high` fails somewhere, if the array starts outside or on
    its limits, or if it is not trained.
    """

    where: Callable[[Any], PyTree]
    low: ArrayLike
    high: ArrayLike


class Interval(eqx.Module):
    """The change of variables of `Bounds`, resolved for one array."""

    low: Array
    high: Array

    def value(self, free: Array) -> Array:
        """The bounded value of a free variable."""
        middle, radius = (self.low + self.high) / 2, (self.high - self.low) / 2
        return middle + radius * jnp.tanh((free - middle) / radius)

    def free(self, value: Array) -> Array:
        """The free variable of a bounded value: the inverse of `value`."""
        middle, radius = (self.low + self.high) / 2, (self.high - self.low) / 2
        return middle + radius * jnp.arctanh((value - middle) / radius)


class Design(eqx.Module):
    """A problem without its trained arrays, and how to put them back. Everything that belongs to a trained array is a
    dictionary by its name, its path in the problem: `"actuation.top.angle"`."""

    frozen: PyTree
    intervals: dict[str, Interval]
    names: tuple[str, ...] = eqx.field(static=True)
    structure: Any = eqx.field(static=True)

    def values(self, free: dict[str, Array]) -> dict[str, Array]:
        """The trained arrays at the optimiser's variables."""
        return {name: self.intervals[name].value(u) if name in self.intervals else u for name, u in free.items()}

    def free(self, values: dict[str, Array]) -> dict[str, Array]:
        """The optimiser's variables at trained arrays."""
        return {name: self.intervals[name].free(x) if name in self.intervals else x for name, x in values.items()}

    def problem(self, values: dict[str, Array]) -> Any:
        """The problem with these trained arrays."""
        return eqx.combine(self.structure.unflatten([values[name] for name in self.names]), self.frozen)


def split(
    problem: Any, where: Callable[[Any], PyTree] | None = None, bounds: Sequence[Bounds] = ()
) -> tuple[Design, dict[str, Array]]:
    """Splits a problem into the design and the values its trained arrays start from.

    **Arguments:**

    - `problem`: the problem.
    - `where`: a function from the problem to the arrays to train; `None`: each inexact array of its actuation.
    - `bounds`: the limits of some of them.

    **Raises:** `ValueError` if `where` picks what cannot be trained, or as `Bounds` says.
    """
    if where is None:
        if not any(eqx.is_inexact_array(leaf) for leaf in jax.tree.leaves(problem.actuation)):
            kind = type(problem.actuation).__name__
            raise ValueError(
                f"where=None trains the inexact arrays of problem.actuation, and {kind} has none: "
                "pass where=lambda p: ... to choose other arrays of the problem."
            )
        names = selected(problem, lambda p: p.actuation, "where=None")
    else:
        names = selected(problem, where, "where")
    return split_at(problem, names, bounds)


def split_at(problem: Any, names: Sequence[str], bounds: Sequence[Bounds] = ()) -> tuple[Design, dict[str, Array]]:
    """As `split`, for arrays given by their names."""
    spec = jax.tree_util.tree_map_with_path(lambda path, _: name_of(path) in names, problem)
    trained, frozen = eqx.partition(problem, spec)
    found = {name_of(path): jnp.asarray(leaf) for path, leaf in jax.tree_util.tree_leaves_with_path(trained)}
    intervals = {}
    for limits in bounds:
        for name in selected(problem, limits.where, "Bounds.where"):
            if name not in found:
                raise ValueError(f"bounds are given for {name}, which is not trained; trained: {', '.join(found)}.")
            intervals[name] = _interval(name, found[name], limits)
    return Design(frozen, intervals, tuple(found), jax.tree.structure(trained)), found


@dataclass(frozen=True)
class Named:
    """Picks arrays from a problem by their names: a `where` that can be sent to another process."""

    names: tuple[str, ...]

    def __call__(self, problem: Any) -> list[Any]:
        found = {name_of(path): leaf for path, leaf in jax.tree_util.tree_leaves_with_path(problem)}
        return [found[name] for name in self.names]


def _interval(name: str, value: Float[Array, "..."], limits: Bounds) -> Interval:
    low, high = (np.asarray(limit, value.dtype) for limit in (limits.low, limits.high))
    for limit in (low, high):
        if limit.ndim > value.ndim or any(
            n not in (1, m) for n, m in zip(limit.shape[::-1], value.shape[::-1], strict=False)
        ):
            raise ValueError(f"a bound of {name} has shape {limit.shape}, which does not broadcast to {value.shape}.")
    if not np.all(low < high):
        raise ValueError(f"the bounds of {name} must have low < high everywhere; found low={low}, high={high}.")
    outside = ~((np.asarray(value) > low) & (np.asarray(value) < high))
    if outside.any():
        raise ValueError(
            f"{name} starts on or outside its bounds at {int(outside.sum())} of {outside.size} entries "
            f"(its range is [{np.min(value):.6g}, {np.max(value):.6g}], low={low}, high={high}): "
            "start strictly inside, or widen the bounds."
        )
    return Interval(jnp.asarray(low), jnp.asarray(high))
