"""Figures of the stored results: `python -m benchmarks.plot [FOLDER]` draws them into `docs/assets`. Needs
matplotlib."""

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib


matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np

from validation.cards import CARDS
from validation.figures import MEASURABLE

from . import results, tables
from .case import Row
from .conditions import ROOT
from .questions import relaxation, scaling, training
from .questions.accuracy import curves, seconds_of


# Okabe and Ito's colours (2008), which can be told apart with any common colour blindness, and grey for the peer.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#222222", "#7f7f7f")
MARKERS = "os^vDPX*"

STYLE: Any = {
    "axes.grid": True,
    "axes.prop_cycle": plt.cycler(color=COLOURS, marker=MARKERS),
    "axes.spines.right": False,
    "axes.spines.top": False,
    "figure.constrained_layout.use": True,
    "font.size": 9,
    "grid.alpha": 0.3,
    "legend.frameon": False,
    "lines.linewidth": 1.5,
    "lines.markersize": 3.5,
    "svg.hashsalt": "shellkit",  # the same file for the same figures
}


def legend_below(axis: plt.Axes) -> None:
    """The names of the curves, where they cover none of them."""
    axis.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)


def _done(rows: list[Row], **case: str) -> list[Row]:
    """The rows that have figures and these arguments."""
    return [row for row in rows if not tables.missing(row) and case.items() <= row["case"].items()]


def _scaling(rows: list[Row]) -> plt.Figure:
    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.4), width_ratios=(3, 2))
    for name, (vertices, seconds) in scaling.times(rows).items():
        look = {"color": "k", "marker": "o", "lw": 2.5} if name == "relaxation" else {}
        left.loglog(vertices, seconds, label=name, **look)
    left.set(xlabel="vertices", ylabel="seconds", title="time")
    legend_below(left)
    wholes = _done(rows, what="relaxation")
    right.loglog([row["n_vertices"] for row in wholes], [scaling.memory(row) for row in wholes], "k-o")
    right.set(xlabel="vertices", ylabel="MB", title="memory of a relaxation")
    return figure


def _relaxation(rows: list[Row]) -> plt.Figure:
    meshes = list(dict.fromkeys(row["case"]["mesh"] for row in _done(rows)))
    figure, axes = plt.subplots(2, len(meshes), figsize=(3.2 * len(meshes), 5), squeeze=False, sharey="row")
    for column, mesh in zip(axes.T, meshes, strict=True):
        for row in _done(rows, mesh=mesh):
            for axis, quantity in zip(column, ("force", "distance"), strict=True):
                axis.loglog(row["trace"]["seconds"], row["trace"][quantity], "-", label=row["case"]["minimiser"])
        column[0].set_title(relaxation.SCENES[mesh].name)
        column[1].set_xlabel("seconds")
    axes[0, 0].set_ylabel("|∇E|")
    axes[1, 0].set_ylabel("distance to the minimum")
    legend_below(axes[1, 0])
    return figure


def _training(scene: str, rows: list[Row]) -> plt.Figure:
    figure, axes = plt.subplots(1, 2, figsize=(8, 3.2), sharey=True)
    for axis, quantity in zip(axes, ("relaxations", "seconds"), strict=True):
        for row in _done(rows, scene=scene):
            axis.semilogy(row["trace"][quantity], row["trace"]["loss"], "-", label=row["case"]["optimiser"])
        axis.set_xlabel(quantity)
    axes[0].set_ylabel("loss")
    legend_below(axes[0])
    figure.suptitle(training.SCENES[scene].name, fontsize=9)
    return figure


_COLOURS = {"SparseNewton": "C0", "implicit": "C0", "NonlinearCG": "C4", "differences": "C1", "LBFGS": "C2"}
_COLOURS |= {"unrolled": "C2", "triangulax": "C7", "triangulax dense": "C7", "triangulax cg": "0.7"}


def _accuracy(rows: list[Row]) -> plt.Figure:
    """Error over seconds: of a mesh, of a relaxation, of a gradient."""
    figure, axes = plt.subplots(1, 3, figsize=(10, 3.8))
    kinds = {"R": ":", "X": "--", "J": "-"}
    methods = {"free sin": "C0", "average sin": "C1", "triangulax": "C7"}
    for name, curve in curves(rows, "mesh").items():
        kind, _, method = name.partition(" ")
        if method in methods:
            look = {"linestyle": kinds[kind], "marker": ".", "color": methods[method]}
            look |= {"label": method.replace(" sin", " normals")} if kind == "J" else {}
            axes[0].loglog(*_points(curve), **look)
    for axis, what in ((axes[1], "solver"), (axes[2], "gradient")):
        for method, curve in curves(rows, what).items():
            seconds, errors = _points(curve)
            marker = "o" if len(errors) == 1 else "."
            axis.loglog(seconds, errors, marker=marker, label=method, color=_COLOURS[method])
    titles = ("of a mesh (J —, X – –, R ···)", "of a relaxation, 642 vertices", "of a gradient, 42 vertices")
    for axis, title in zip(axes, titles, strict=True):
        axis.xaxis.set_minor_formatter("")
        axis.set(xlabel="seconds", title=title)
        legend_below(axis)
    axes[0].set_ylabel("error")
    return figure


def _points(curve: list[Row]) -> tuple[list[float], list[float]]:
    known = [row for row in curve if row["error"] is not None]
    return [seconds_of(row) for row in known], [row["error"] for row in known]


_MARKERS = {"R": "o", "X": "s", "J": "^"}  # of regular, alternating and jittered triangles


def _card(name: str, rows: list[Row]) -> plt.Figure | None:
    """Errors against the mesh size, a panel for each quantity that was refined."""
    lines = []
    for one in next((row["series"] for row in rows if row["label"] == name), ()):
        points = [point for point in zip(one["cells"], one["error"], strict=True) if point[0] > 0]
        points = [(cells, abs(error)) for cells, error in points if abs(error) > MEASURABLE]
        if len(points) > 1:
            lines.append((one["quantity"], one["series"], *zip(*points, strict=True)))
    quantities = list(dict.fromkeys(quantity for quantity, *_ in lines))[:4]
    if not quantities:
        return None
    figure, axes = plt.subplots(1, len(quantities), figsize=(3.6 * len(quantities), 3.8), squeeze=False)
    colours: dict[str, str] = {}  # of each method, in all panels
    for axis, quantity in zip(axes[0], quantities, strict=True):
        shown = [line[1:] for line in lines if line[0] == quantity]
        for series, cells, errors in shown:
            method, _, triangles = series.rpartition(", ")
            method = method or ("" if triangles in _MARKERS else series)
            colour = colours.setdefault(method, COLOURS[len(colours)])
            look = {"marker": _MARKERS.get(triangles, "D"), "linestyle": "--" if "average" in series else "-"}
            axis.loglog(cells, errors, color=colour, label=series, **look)
        ticks = sorted({size for _, cells, _ in shown for size in cells})
        reference = np.array([ticks[0], ticks[-1]])
        top = max(errors[0] for *_, errors in shown)
        axis.loglog(reference, top * (reference / reference[0]) ** -2.0, "k:", lw=1, label="second order")
        axis.set_xticks(ticks, [f"{tick:.3g}" for tick in ticks])
        axis.minorticks_off()
        axis.set(xlabel="cells a side", title=quantity)
        legend_below(axis)
    axes[0, 0].set_ylabel("relative error")
    return figure


# The name of the file, the benchmark, how it is drawn.
_FIGURES: list[tuple[str, str, Callable[[list[Row]], plt.Figure | None]]] = [
    ("benchmark_scaling.svg", "scaling", _scaling),
    ("benchmark_relaxation.svg", "relaxation", _relaxation),
    *((f"benchmark_training_{scene}.svg", "training", partial(_training, scene)) for scene in training.SCENES),
    ("benchmark_accuracy.png", "accuracy", _accuracy),
    *((f"validation_{name}.png", "cards", partial(_card, name)) for name in CARDS),
]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.plot", description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "docs" / "assets")
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    with plt.rc_context(STYLE):
        for name, benchmark, draw in _FIGURES:
            rows = results.load(benchmark)
            if not rows:
                print(f"{name}: no results yet, run python -m benchmarks {benchmark}")
            elif figure := draw(rows):
                options: Any = {"metadata": {"Date": None}}
                if name.endswith("png"):
                    options = {"metadata": {"Software": None}, "dpi": 80 if benchmark == "cards" else 90}
                figure.savefig(folder / name, **options)
                plt.close(figure)
                print(folder / name)


if __name__ == "__main__":
    main()
