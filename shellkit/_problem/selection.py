"""Which arrays a function picks from a problem, and by which names: their paths, as in `"actuation.top.angle"`."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, PyTree


_LISTED = 12  # names in a message


def named_arrays(problem: Any) -> dict[str, Array]:
    """The floating-point arrays of a problem by their names."""
    leaves = jax.tree_util.tree_leaves_with_path(problem)
    return {name_of(path): leaf for path, leaf in leaves if eqx.is_inexact_array(leaf)}


def selected(problem: Any, where: Callable[[Any], PyTree], what: str) -> list[str]:
    """The names of the arrays that a function picks from a problem, found by handing it a copy of the problem whose
    arrays are known by their identity.

    What it picks are arrays, or parts of the problem: of a part each floating-point array counts, and whatever else is
    in it (activation functions, integers) is left alone.
    """
    leaves = {name_of(path): leaf for path, leaf in jax.tree_util.tree_leaves_with_path(problem)}
    copies = {name: jax.device_put(np.asarray(leaf)) for name, leaf in leaves.items() if eqx.is_inexact_array(leaf)}
    marked = jax.tree_util.tree_map_with_path(lambda path, _: copies.get(name_of(path), _Mark(name_of(path))), problem)
    try:
        items = list(_items(where(marked)))
    except Exception as error:
        raise ValueError(
            f"{what} must only pick parts of the problem, as in lambda p: (p.actuation.top.angle, "
            f"p.actuation.bottom.angle); it failed with {type(error).__name__}: {error}"
        ) from error
    if not items:
        raise ValueError(
            f"{what} picked nothing from the problem: let it return at least one array. There are {_listed(copies)}."
        )
    names_of = {id(copy): name for name, copy in copies.items()}
    names: list[str] = []
    for place, item in enumerate(items):
        for name in _names_in(item, names_of, leaves, f"{what}: item {place}"):
            if name in names:
                raise ValueError(f"{what} picked {name} twice.")
            names.append(name)
    return names


def _items(picked: PyTree) -> Iterator[Any]:
    """What was picked, out of the tuples, lists and dictionaries that it was put in."""
    if isinstance(picked, dict):
        picked = list(picked.values())
    if type(picked) in (tuple, list):
        for item in picked:
            yield from _items(item)
    else:
        yield picked


def _names_in(item: Any, names_of: dict[int, str], leaves: dict[str, Any], place: str) -> list[str]:
    """The names of an array that was picked, or of all arrays in a part that was."""
    if item is None:
        raise ValueError(f"{place} is None: an absent part. Pick floating-point arrays of the problem.")
    if isinstance(item, _Mark):
        leaf = leaves[item.name]
        kind = f"an array of {leaf.dtype}" if eqx.is_array(leaf) else f"a {type(leaf).__name__}"
        raise ValueError(
            f"{place} is {item.name}, {kind}: only floating-point arrays can be trained. Make it a jnp array of "
            "floats, or leave it out."
        )
    inside = jax.tree.leaves(item)
    if jax.tree_util.all_leaves([item]) and id(item) not in names_of:
        said = f"a new array of shape {item.shape}" if eqx.is_array(item) else repr(item)
        raise ValueError(
            f"{place} is {said}, which is no array of the problem. Pick floating-point arrays as they are, without "
            "sums and slices."
        )
    names = [names_of[id(leaf)] for leaf in inside if id(leaf) in names_of]
    if not names:
        others = {leaf.name: leaf for leaf in inside if isinstance(leaf, _Mark)}
        raise ValueError(
            f"{place}, a {type(item).__name__}, holds no floating-point array, which alone can be trained; it holds "
            f"{_listed(others)}."
        )
    return names


def _listed(named: Mapping[str, Any]) -> str:
    names = list(named)
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return (", ".join(names[:_LISTED]) or "nothing") + more


@dataclass(frozen=True)
class _Mark:
    name: str


def name_of(path: Any) -> str:
    """The name of a leaf, from its path in the tree."""
    return jax.tree_util.keystr(path, simple=True, separator=".")
