"""One measured figure against its exact value, and the order at which a series of them converges."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np


MEASURABLE = 1e-9  # an error below this is rounding: it has no order


@dataclass(frozen=True)
class Figure:
    """A number that shellkit computed, the exact one, and what it was computed on.

    Where `exact` is zero the error is `ours` itself. `seconds` is a second run, without compilation.
    """

    quantity: str
    series: str  # the mesh and whatever else was varied
    cells: float  # one over the mesh size; 0 where no mesh is refined
    exact: float
    ours: float
    seconds: float

    @property
    def error(self) -> float:
        """Relative to the exact value, with its sign."""
        return self.ours / self.exact - 1 if self.exact else self.ours


def order(figures: Iterable[Figure]) -> float:
    """The order at which the figures of one series converge."""
    cells, errors = zip(*((figure.cells, figure.error) for figure in figures), strict=True)
    return slope(cells, errors)


def slope(cells: Sequence[float], errors: Sequence[float]) -> float:
    """The slope of log error against log mesh size, by least squares."""
    return -float(np.polyfit(np.log(cells), np.log(np.abs(errors)), 1)[0])


def by_series(figures: Iterable[Figure]) -> dict[tuple[str, str], list[Figure]]:
    """The figures of each quantity and series, from coarse to fine."""
    groups: dict[tuple[str, str], list[Figure]] = {}
    for figure in figures:
        groups.setdefault((figure.quantity, figure.series), []).append(figure)
    return {key: sorted(group, key=lambda figure: figure.cells) for key, group in groups.items()}


def timed(function: Callable[[], Any]) -> tuple[Any, float]:
    """The value of a function and how long a second call takes."""
    jax.block_until_ready(function())
    start = time.perf_counter()
    value = jax.block_until_ready(function())
    return value, time.perf_counter() - start
