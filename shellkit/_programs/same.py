"""Functions of optax made twice from the same code and numbers, such as two calls of `optax.adam(0.1)`: one stands for
all, so that what was compiled for it serves them all."""

from collections import OrderedDict
from types import FunctionType
from typing import Any, TypeVar


Made = TypeVar("Made")

_REMEMBERED = 64
_first: OrderedDict[Any, Any] = OrderedDict()


def first_like(made: Made) -> Made:
    """The first of its kind that was asked for: a function, or a tuple of such, with the same code and the same values
    in its closure. Itself, where a value cannot be compared, or a function is not optax's own: that of a user may read
    globals, which can have changed since."""
    try:
        key = _signature(made)
        found = _first.pop(key, made)
    except (TypeError, ValueError):
        return made
    _first[key] = found
    while len(_first) > _REMEMBERED:
        _first.popitem(last=False)
    return found


def _signature(made: Any) -> Any:
    if isinstance(made, FunctionType):
        if made.__globals__.get("__name__", "").partition(".")[0] != "optax":
            raise TypeError(f"{made.__qualname__} may read what is not in its closure.")
        cells = tuple(_signature(cell.cell_contents) for cell in made.__closure__ or ())
        keywords = tuple(sorted((made.__kwdefaults__ or {}).items()))
        return made.__code__, _signature(made.__defaults__ or ()), _signature(keywords), cells
    if isinstance(made, tuple | list):
        return type(made), tuple(map(_signature, made))
    if isinstance(made, dict):
        return dict, tuple((name, _signature(value)) for name, value in made.items())
    hash(made)
    # Numbers that are equal need not be the same to a program.
    return type(made), made
