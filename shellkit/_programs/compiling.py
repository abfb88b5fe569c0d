"""Programs that compile fast, for what a user waits for before the first step."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax

from .tracing import is_traced, is_tracing


# On a CPU, kernels made by XLA's emitter of before take a third less time to compile, and run 3 to 5 % longer. From JAX
# 0.11.1 on there is no choice.
FAST: dict[str, Any] = {"xla_cpu_use_fusion_emitters": False} if jax.__version_info__ < (0, 11, 1) else {}
# With fewer passes of LLVM it is half, and 8 to 10 %: for a small part of a step.
FASTEST = {**FAST, "xla_backend_optimization_level": 1}


class Program:
    """A function compiled by itself, with options of its own; inside another program it is a part of that, and has
    those of it. Like `equinox.filter_jit`, arrays are its arguments, and everything else is static."""

    def __init__(self, function: Callable, options: dict[str, Any]):
        self._inside: Any = eqx.filter_jit(function)
        jit: Any = eqx.filter_jit  # which passes on what it does not know
        self._alone: Any = jit(function, compiler_options=options)
        self.__name__, self.__doc__ = function.__name__, function.__doc__

    def __call__(self, *arguments: Any) -> Any:
        # Known arguments may stand in a program that is traced for others: there the function is a part of that.
        return (self._inside if is_tracing() else self._of(arguments))(*arguments)

    def lower(self, *arguments: Any) -> Any:
        """As that of `equinox.filter_jit`: traced and lowered, to be compiled."""
        return self._of(arguments).lower(*arguments)

    def _of(self, arguments: tuple) -> Any:
        return self._inside if jax.default_backend() != "cpu" or is_traced(arguments) else self._alone


def program(options: dict[str, Any]) -> Callable[[Callable], Program]:
    """Decorates a function to be a [`Program`][] with these options of the compiler."""
    return lambda function: Program(function, options)
