"""Keywords of earlier releases, which go on working for one release: each warns, and says what takes its place."""

import functools
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any, ParamSpec, TypeVar

from .checkpoint import Checkpoint
from .choices import Refuse, WarmStart
from .observers import JsonLines, Stop, TensorBoard


P = ParamSpec("P")
R = TypeVar("R")

_REFUSE = {"unconverged": "unconverged", "max_rise": "rise", "max_refusals": "most"}
_STOP = {"patience": "patience", "tolerance": "tolerance", "max_seconds": "seconds"}
_GUESSES = {"rest": None, "last": WarmStart("last"), "predicted": WarmStart("predicted")}
_REPORTERS = {"log": JsonLines, "tensorboard": TensorBoard}


def takes_retired(function: Callable[P, R]) -> Callable[P, R]:
    """The same function, which takes the keywords of the last release as well."""

    @functools.wraps(function)
    def call(*args: P.args, **options: P.kwargs) -> R:
        present, replaced = _present(function.__name__, options)
        for old, new in replaced.items():
            warnings.warn(
                f"{function.__name__}({old}=…) is deprecated and goes with the next release: use {new}.",
                DeprecationWarning,
                stacklevel=2,
            )
        return function(*args, **present)  # pyright: ignore[reportCallIssue]

    return call


def _present(function: str, options: dict[str, Any]) -> tuple[dict[str, Any], dict[str, str]]:
    """The options in today's words, and what takes the place of each that is of the last release."""
    options, new = dict(options), {}
    if "optimiser" in options:
        options["method"] = options.pop("optimiser")
        new["optimiser"] = "method=…, or the second place"

    for old, name in _REFUSE.items():
        if old in options:
            value = options.pop(old)
            if old == "unconverged":
                _check_word(old, value, "refuse", "accept")
                value = value == "refuse"
            options["refuse"] = replace(options.get("refuse", Refuse()), **{name: value})
            new[old] = f"refuse=sk.Refuse({name}={value!r})"

    further: list[Any] = []
    for old, kind in _REPORTERS.items():
        if old in options:
            place = options.pop(old)
            further += [] if place is None else [kind(place)]
            new[old] = f"callbacks=[sk.{kind.__name__}({str(place)!r})]"
    limits = {name: options.pop(old) for old, name in _STOP.items() if old in options}
    further += [Stop(**limits)] if limits else []
    new |= {old: f"callbacks=[sk.Stop({name}={limits[name]!r})]" for old, name in _STOP.items() if name in limits}
    if further:
        options["callbacks"] = [*options.get("callbacks", ()), *further]

    guess: Any = options.get("warm_start")
    if isinstance(guess, str):
        _check_word("warm_start", guess, *_GUESSES)
        options["warm_start"] = _GUESSES[guess]
        new["warm_start"] = "None, as it is without it" if guess == "rest" else f"warm_start=sk.WarmStart({guess!r})"
    if "check_every" in options:
        every = options.pop("check_every")
        warm = replace(options.get("warm_start") or WarmStart(), check_every=every)
        if options.get("warm_start") is not None:
            options["warm_start"] = warm
        new["check_every"] = f"warm_start=sk.{warm!r}"

    if "checkpoint_every" in options:
        place = "folder" if function == "fit_many" else "checkpoint"
        kept = Checkpoint(options.get(place) or "run", options.pop("checkpoint_every"))
        if options.get(place) is not None:
            options[place] = kept
        new["checkpoint_every"] = f"{place}=sk.Checkpoint({str(kept.path)!r}, every={kept.every!r})"
    return options, new


def _check_word(name: str, word: Any, *words: str) -> None:
    if word not in words:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, words))}; got {word!r}.")
