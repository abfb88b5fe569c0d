"""One step of training, value and gradient of the loss through the relaxation: shellkit against triangulax."""

from typing import NamedTuple

import numpy as np

from . import report
from .case import Case, Row


_LIBRARIES = {
    "shellkit": "shellkit",
    "shellkit-threads": "shellkit, `MKL_NUM_THREADS=2`",
    "shellkit-tan": 'shellkit, `form="tan"`',
    "triangulax-published": "triangulax as published",
    "triangulax-cg": "triangulax, CG adjoint",
}


class Scene(NamedTuple):
    """What is designed on a mesh, and what the peer needs for it."""

    title: str
    loss: str
    stretch: float
    max_steps: int
    dense_gb: float  # memory of the adjoint as published
    dense_runs: int


_SCENES = {
    "icosphere-1": Scene("42 vertices, ellipsoid, λ = 1.1", "ellipsoid", 1.1, 4000, 1.0, 9),
    "icosphere-3": Scene("642 vertices, ellipsoid, λ = 1.1", "ellipsoid", 1.1, 4000, 4.0, 3),
    "suzanne": Scene("Suzanne, 1400 vertices, neo-Hookean, sphericity, λ = 1.5", "sphericity", 1.5, 8000, 15.0, 1),
    "icosphere-4": Scene("2562 vertices, ellipsoid, λ = 1.1", "ellipsoid", 1.1, 4000, 48.0, 1),
}
_FIELDS = ("zero", "random")


def cases(quick: bool) -> list[Case]:
    found = []
    for mesh, scene in _SCENES.items():
        if quick and mesh != "icosphere-1":
            continue
        for field in _FIELDS:
            common = {"mesh": mesh, "loss": scene.loss, "stretch": scene.stretch, "field": field}
            ours = common | {"form": "sin", "runs": 9}
            theirs = common | {"max_steps": scene.max_steps}
            dense = theirs | {"adjoint": "dense", "forward": False, "runs": scene.dense_runs}
            cg = theirs | {"adjoint": "cg", "forward": True, "runs": 3}
            found.append(Case(f"{mesh} {field} shellkit", "design_step", ours))
            found.append(
                Case(f"{mesh} {field} shellkit-threads", "design_step", ours, settings={"MKL_NUM_THREADS": "2"})
            )
            if scene.loss == "sphericity":
                found.append(Case(f"{mesh} {field} shellkit-tan", "design_step", ours | {"form": "tan"}))
            label = f"{mesh} {field} triangulax"
            found.append(Case(f"{label}-published", "peer", dense, of_peer=True, needs_gb=scene.dense_gb))
            found.append(Case(f"{label}-cg", "peer", cg, of_peer=True, needs_gb=2.0))
    return found


def page(rows: list[Row]) -> str:
    sections = []
    for mesh, scene in _SCENES.items():
        for field in _FIELDS:
            here = {
                row["label"].split()[2]: row
                for row in rows
                if row["case"]["mesh"] == mesh and row["case"]["field"] == field
            }
            if here:
                sections.append(f"### {scene.title}, director field {field}\n\n{_table(here)}")
    return "\n\n".join([_INTRODUCTION, *sections])


_INTRODUCTION = """\
A design step is the loss and its gradient in all director angles, through the relaxation from rest, as in the tutorial
of triangulax: ellipsoid and Suzanne, thickness 0.1. *As published* is `NonlinearCG(rtol=1e-9, atol=1e-9)` with
optimistix's own adjoint, which builds the Hessian as a dense matrix; *CG adjoint* solves the adjoint system by
conjugate gradients, without a matrix. PARDISO runs on one thread unless the environment says otherwise, the rest of
shellkit on two, as triangulax does. Times are medians (fastest–slowest), without compilation; the first run of
shellkit holds the symbolic factorisation. |∇E| is the Euclidean norm where the relaxation ended, and the energy is
counted from the lowest that any found. Memory is what running, and before it compiling, add at their peaks. The last
columns compare with shellkit: the largest difference in the distances of 64 pairs of vertices (the unit is the
radius), the relative error of the loss's gradient, and the time of a design step."""

_HEAD = (
    "",
    "design step",
    "relaxation alone",
    "first run",
    "compilation",
    "steps",
    "factorisations",
    "&#124;∇E&#124;",
    "E − lowest",
    "memory to run",
    "to compile",
    "shape off by",
    "gradient off by",
    "time, shellkit = 1",
)


def _table(here: dict[str, Row]) -> str:
    done = {name: row for name, row in here.items() if not report.missing(row)}
    # The same relaxation, measured once.
    if "triangulax-published" in done and "triangulax-cg" in done:
        done["triangulax-published"] = done["triangulax-published"] | {"forward": done["triangulax-cg"]["forward"]}
    lowest = min((row["energy"] for name, row in done.items() if name != "shellkit-tan"), default=0.0)
    lines = []
    for name, title in _LIBRARIES.items():
        if name in done:
            own = done[name]["energy"] if name == "shellkit-tan" else lowest
            lines.append([title, *_figures(done[name], own), *_beside(done[name], done.get("shellkit"))])
        elif name in here:
            lines.append([title, f"*{report.missing(here[name])}*", *[""] * (len(_HEAD) - 2)])
    return report.table(_HEAD, lines)


def _figures(row: Row, lowest: float) -> list[str]:
    return [
        report.span(row),
        report.span(row["forward"]) if "forward" in row else "",
        report.seconds(row["first_s"]),
        report.seconds(row["compile_s"]),
        str(row["steps"]) + ("" if row["converged"] else ", not converged"),
        str(row.get("factorisations", "")),
        report.small(row["force_norm"]),
        report.small(row["energy"] - lowest),
        report.megabytes(row["run_mb"]),
        report.megabytes(row["compile_mb"]),
    ]


def _beside(row: Row, ours: Row | None) -> list[str]:
    """How far shape and gradient are from shellkit's, and how much longer it took."""
    if ours is None or row is ours:
        return ["", "", ""]
    slower = f"{report.three_digits(report.time(row) / report.time(ours))}"
    if "adjoint" not in row["case"] or not ours["converged"]:
        return ["", "", slower]
    shape, exact_shape = np.array(row["shape_probes"]), np.array(ours["shape_probes"])
    gradient, exact = np.array(row["gradient_probes"]), np.array(ours["gradient_probes"])
    return [
        report.small(np.max(np.abs(shape - exact_shape))),
        report.small(np.linalg.norm(gradient - exact) / np.linalg.norm(exact)),
        slower,
    ]
