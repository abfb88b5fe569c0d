"""The checks of the sizes that mesh generators are asked for."""

import numpy as np


def positive(**sizes: float) -> None:
    """Raises a `ValueError` unless every size named is a positive number."""
    for name, value in sizes.items():
        if not (np.ndim(value) == 0 and np.isfinite(value) and value > 0):
            raise ValueError(f"{name} is {value}; expected a positive number.")


def one_of(cells: tuple[int, int] | None, target_edge_length: float | None) -> None:
    """Raises a `ValueError` unless exactly one way to say the resolution is taken."""
    if (cells is None) == (target_edge_length is None):
        raise ValueError(
            f"cells is {cells}, target_edge_length is {target_edge_length}; give one of the two, not both."
        )
    if target_edge_length is not None:
        positive(target_edge_length=target_edge_length)


def cell_counts(
    cells: tuple[int, int] | None,
    target_edge_length: float | None,
    spans: tuple[float, float],
    least: tuple[int, int],
) -> tuple[int, int]:
    """Two numbers of cells: those given, or as many as edges of the target length fit into two spans.

    **Raises:** `ValueError` for cells that are not whole or below the least that makes a surface.
    """
    one_of(cells, target_edge_length)
    if target_edge_length is not None:
        nx, ny = (max(low, round(span / target_edge_length)) for span, low in zip(spans, least, strict=True))
        return nx, ny
    if cells is None or len(cells) != 2 or any(int(n) != n or n < low for n, low in zip(cells, least, strict=True)):
        raise ValueError(f"cells is {cells}; expected two whole numbers, at least {least}.")
    return int(cells[0]), int(cells[1])
