"""What `jax.vmap` does with a relaxation: its members are worked off in turn, inside one program."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax


def in_turn(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function whose members under `jax.vmap` are evaluated one after another, by one loop in one program.

    A batch that runs in lockstep takes as many steps as the slowest of its members, and both sides of every branch.
    Arrays are mapped over, whatever else is among the arguments is not. It cannot be differentiated.
    """

    def mapped(*arguments: Any) -> Any:
        dynamic, static = eqx.partition(arguments, eqx.is_array)
        others = []

        @jax.custom_batching.sequential_vmap
        def arrays(dynamic: Any) -> Any:
            found, other = eqx.partition(function(*eqx.combine(dynamic, static)), eqx.is_array)
            others.append(other)
            return found

        found = arrays(dynamic)
        return eqx.combine(found, others[-1])

    return mapped
