"""Figures of the stored results: `python -m benchmarks.plot [FOLDER]` draws them into `docs/assets`. Needs
matplotlib."""

import sys
from functools import partial
from pathlib import Path

import matplotlib.pyplot as plt

from . import report
from .accuracy import gradients, meshes, solvers
from .case import ROOT, Row
from .relaxation import SCENES
from .scaling import memory, times
from .training import SCENES as TRAINED


# Okabe and Ito's colours (2008), which can be told apart with any common colour blindness, and grey for the peer.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#222222", "#7f7f7f")
MARKERS = "os^vDPX*"

STYLE = {
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


def _scaling(rows: list[Row]) -> plt.Figure:
    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.4), width_ratios=(3, 2))
    for name, (vertices, seconds) in times(rows).items():
        whole = name == "relaxation"
        look = {"color": "k", "marker": "o", "lw": 2.5} if whole else {}
        left.loglog(vertices, seconds, label=name, **look)
    left.set(xlabel="vertices", ylabel="seconds", title="time")
    legend_below(left)
    wholes = [row for row in rows if row["case"]["what"] == "relaxation" and not report.missing(row)]
    right.loglog([row["n_vertices"] for row in wholes], [memory(row) for row in wholes], "k-o")
    right.set(xlabel="vertices", ylabel="MB", title="memory of a relaxation")
    return figure


def _relaxation(rows: list[Row]) -> plt.Figure:
    meshes = list(dict.fromkeys(row["case"]["mesh"] for row in rows if not report.missing(row)))
    figure, axes = plt.subplots(2, len(meshes), figsize=(3.2 * len(meshes), 5), squeeze=False, sharey="row")
    for column, mesh in zip(axes.T, meshes, strict=True):
        for row in rows:
            if row["case"]["mesh"] != mesh or report.missing(row):
                continue
            seconds = [point["seconds"] for point in row["trace"]]
            for axis, quantity in zip(column, ("force", "distance"), strict=True):
                axis.loglog(seconds, [point[quantity] for point in row["trace"]], "-", label=row["case"]["minimiser"])
        column[0].set_title(SCENES[mesh].name)
        column[1].set_xlabel("seconds")
    axes[0, 0].set_ylabel("|∇E|")
    axes[1, 0].set_ylabel("distance to the minimum")
    legend_below(axes[1, 0])
    return figure


def _training(scene: str, rows: list[Row]) -> plt.Figure:
    figure, axes = plt.subplots(1, 2, figsize=(8, 3.2), sharey=True)
    for row in rows:
        if row["case"]["scene"] != scene or report.missing(row):
            continue
        for axis, quantity in zip(axes, ("relaxations", "seconds"), strict=True):
            points = [(point[quantity], point["loss"]) for point in row["trace"]]
            axis.semilogy(*zip(*points, strict=True), "-", label=row["case"]["optimiser"])
            axis.set_xlabel(quantity)
    axes[0].set_ylabel("loss")
    legend_below(axes[0])
    figure.suptitle(TRAINED[scene].name, fontsize=9)
    return figure


_COLOURS = {
    "SparseNewton": "C0",
    "implicit": "C0",
    "NonlinearCG": "C4",
    "differences": "C1",
    "LBFGS": "C2",
    "unrolled": "C2",
    "triangulax": "C7",
    "triangulax dense": "C7",
    "triangulax cg": "0.7",
}


def accuracy(rows: list[Row]) -> plt.Figure:
    """Error over seconds: of a mesh, of a relaxation, of a gradient."""
    figure, axes = plt.subplots(1, 3, figsize=(10, 3.8))
    kinds = {"R": ":", "X": "--", "J": "-"}
    methods = {"free sin": "C0", "average sin": "C1", "triangulax": "C7"}
    for (kind, method), curve in meshes(rows).items():
        if method in methods:
            seconds, errors = [point[2] for point in curve], [point[1] for point in curve]
            label = method.replace(" sin", " normals") if kind == "J" else None
            axes[0].loglog(seconds, errors, linestyle=kinds[kind], marker=".", color=methods[method], label=label)
    for axis, curves in ((axes[1], solvers(rows)), (axes[2], gradients(rows))):
        for method, curve in curves.items():
            points = [(point[2], point[1]) for point in curve if point[1] == point[1]]
            marker = "o" if len(points) == 1 else "."
            axis.loglog(*zip(*points, strict=True), marker=marker, label=method, color=_COLOURS[method])
    titles = ("of a mesh (J —, X – –, R ···)", "of a relaxation, 642 vertices", "of a gradient, 42 vertices")
    for axis, title in zip(axes, titles, strict=True):
        axis.xaxis.set_minor_formatter("")
        axis.set(xlabel="seconds", title=title)
        legend_below(axis)
    axes[0].set_ylabel("error")
    return figure


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "assets"
    folder.mkdir(parents=True, exist_ok=True)
    with plt.rc_context(STYLE):
        figures = {"scaling": ("scaling", _scaling), "relaxation": ("relaxation", _relaxation)}
        for scene in TRAINED:
            figures[f"training_{scene}"] = ("training", partial(_training, scene))
        for figure, (name, draw) in figures.items():
            if rows := report.load(name):
                path = folder / f"benchmark_{figure}.svg"
                draw(rows).savefig(path, metadata={"Date": None})
                print(path)
            else:
                print(f"{name}: no results yet, run python -m benchmarks {name}")
        if rows := report.load("accuracy"):
            accuracy(rows).savefig(folder / "benchmark_accuracy.png", dpi=90, metadata={"Software": None})
            print(folder / "benchmark_accuracy.png")


if __name__ == "__main__":
    main()
