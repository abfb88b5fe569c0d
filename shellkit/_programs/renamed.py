"""Public names of before, which go on working for a release and say what they are called now."""

import functools
import warnings
from collections.abc import Callable
from typing import Any, TypeVar


Function = TypeVar("Function", bound=Callable[..., Any])


def formerly(name: str, function: Function) -> Function:
    """A function under its name of before: it warns, and does the same."""

    @functools.wraps(function)
    def under_old_name(*arguments: Any, **keywords: Any) -> Any:
        warnings.warn(f"shellkit.{name} is now shellkit.{function.__name__}.", DeprecationWarning, stacklevel=2)
        return function(*arguments, **keywords)

    under_old_name.__doc__ = (
        f"The name of before of [`shellkit.{function.__name__}`][]; see there.\n\n{function.__doc__}"
    )
    return under_old_name  # pyright: ignore[reportReturnType]
