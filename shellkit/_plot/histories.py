"""The course of a fit as curves: the loss and its terms at every step."""

import os
from collections.abc import Mapping
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from .._fit.history import FitResult
from . import palette


if TYPE_CHECKING:
    from matplotlib.figure import Figure


# The columns of a history that are neither the loss nor a term of it.
_DIAGNOSTICS = {
    "gradient_norm",
    "solver_steps",
    "relaxation_gradient_norm",
    "converged",
    "stable",
    "refused",
    "update_scale",
    "control",
    "products",
    "seconds",
    "warm_gap",
}
_AXES = {"step": "step", "seconds": "time (s)"}


def plot_history(
    history: FitResult | Mapping[str, Any],
    *,
    against: str = "step",
    title: str | None = None,
    size: tuple[float, float] = (6.4, 3.8),
    save: str | os.PathLike | None = None,
) -> "Figure":
    """Draws the loss of a fit and each term of it, on a logarithmic axis.

    Terms are drawn as they are recorded, without their weights: they need not add up to the loss. What is not positive
    has no place on a logarithmic axis and is left out, and so is a term that is the whole loss. The best design of a
    result is marked on the curve of the loss, and a step before which designs were refused by a cross.

    **Arguments:**

    - `history`: a [`shellkit.FitResult`][], its [`shellkit.History`][], or any mapping from names to columns of one
        length, with a `"loss"`.
    - `against`: `"step"`, or the name of a column that grows, such as `"seconds"`.
    - `title`: a line above the curves.
    - `size`: width and height in inches.
    - `save`: a file to write, of a type that matplotlib knows, such as png, svg or pdf.

    **Returns:** the `Figure` of matplotlib, with its axes in `figure.axes[0]`. At the end of a cell of a notebook it
    shows as a picture.

    **Raises:** `ValueError` for a history without a loss, without steps, or without the column `against`.

    ??? example

        ```python
        result = sk.fit(problem, optax.adam(0.1), steps=200)
        sk.plot_history(result, save="history.png")
        ```
    """
    columns = history.history if isinstance(history, FitResult) else history
    if "loss" not in columns or len(columns["loss"]) == 0:
        raise ValueError(f"plot_history: no steps of a loss to draw; the columns are: {', '.join(columns) or 'none'}.")
    if against != "step" and against not in columns:
        raise ValueError(f"plot_history: there is no column {against!r}; there are: step, {', '.join(columns)}.")
    from matplotlib import rc_context

    with rc_context({"axes.spines.top": False, "axes.spines.right": False, "svg.fonttype": "none"}):
        figure = _new_figure(size)
        axes = figure.subplots()
        loss = np.asarray(columns["loss"], dtype=float)
        x = np.arange(len(loss)) if against == "step" else np.asarray(columns[against], dtype=float)
        terms = [name for name in columns if name not in _DIAGNOSTICS and name not in ("loss", against)]
        terms = [name for name in terms if not np.array_equal(columns[name], loss)]
        _draw_curve(axes, x, loss, "loss", color=palette.TEXT, linewidth=2.2, zorder=3)
        for k, name in enumerate(terms):
            _draw_curve(axes, x, columns[name], name, color=palette.LINES[k % len(palette.LINES)], linewidth=1.4)
        _mark_refusals(axes, x, loss, columns)
        if isinstance(history, FitResult):
            # The design after the last update has no row of its own.
            place = history.best_step if against == "step" else x[min(history.best_step, len(x) - 1)]
            best = f"best: {history.best_loss:.3g}"
            axes.plot(place, history.best_loss, "o", color=palette.TEXT, zorder=4, label=best)
        axes.set_yscale("log", nonpositive="mask")
        axes.set_xlabel(_AXES.get(against, against))
        axes.set_ylabel("loss and its terms, without weights" if terms else "loss")
        axes.set_title(title or "", fontsize="medium")
        axes.grid(axis="y", color="#dddddd", linewidth=0.6)
        axes.set_axisbelow(True)
        # Below the axes, where it hides no curve.
        figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize="small")
        if save is not None:
            figure.savefig(save, dpi=200)
    return figure


def _new_figure(size: tuple[float, float]) -> "Figure":
    # Not by pyplot, which would keep the figure alive and open a window for it.
    from matplotlib.figure import Figure

    class ShownFigure(Figure):
        """A figure that a notebook shows as a picture although pyplot knows nothing of it."""

        def _repr_png_(self) -> bytes:
            picture = BytesIO()
            self.savefig(picture, format="png", dpi=120)
            return picture.getvalue()

    return ShownFigure(figsize=size, layout="constrained")


def _draw_curve(axes: Any, x: np.ndarray, values: Any, label: str, **look: Any) -> None:
    values = np.asarray(values, dtype=float)
    axes.plot(x, np.where(values > 0, values, np.nan), label=label, **look)


def _mark_refusals(axes: Any, x: np.ndarray, loss: np.ndarray, columns: Mapping[str, Any]) -> None:
    refused = np.flatnonzero(columns.get("refused", ()))
    if len(refused):
        axes.plot(x[refused], loss[refused], "x", color=palette.LINES[3], label="after a refused design", zorder=4)
