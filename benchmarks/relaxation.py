"""Relaxation: force and distance to the minimum against time, for SparseNewton and optimistix's minimisers."""

from typing import NamedTuple

from . import report
from .case import Case, Row


class Scene(NamedTuple):
    """What is relaxed on a mesh."""

    field: str
    name: str
    details: str


SCENES = {
    "icosphere-1": Scene("teacher", "42 vertices", "teacher, λ = 1.1"),
    "icosphere-3": Scene("teacher", "642 vertices", "teacher, λ = 1.1"),
    "suzanne": Scene("random", "Suzanne, 1400 vertices", 'neo-Hookean, `form="tan"`, random directors, λ = 1.5'),
}
_MINIMISERS = ("SparseNewton", "NonlinearCG", "LBFGS", "BFGS")
_FORCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)


def cases(quick: bool) -> list[Case]:
    return [
        Case(
            f"{mesh} {minimiser}",
            "relaxation",
            {
                "mesh": mesh,
                "field": scene.field,
                "minimiser": minimiser,
                "max_steps": 1000 if quick else 20_000,
                "limit_s": 5.0 if quick else 20.0,
                "runs": 1 if quick else 3,
            },
        )
        for mesh, scene in SCENES.items()
        for minimiser in _MINIMISERS
        # BFGS keeps a dense matrix.
        if mesh == "icosphere-1" or (minimiser != "BFGS" and not quick)
    ]


def page(rows: list[Row]) -> str:
    sections = []
    for mesh, scene in SCENES.items():
        here = [row for row in rows if row["case"]["mesh"] == mesh]
        if here:
            sections.append(f"### {scene.name}, {scene.details}\n\n{_table(here)}")
    return "\n\n".join([_INTRODUCTION, *sections])


_INTRODUCTION = """\
Every minimiser starts at rest and goes on, with no tolerance, to where rounding stops it, or for 20 s. Times until the
Euclidean norm of ∇E first falls below a bound, medians of three descents, without compilation; *end* is the smallest
force met, and how far the shape there is from the minimum (largest vertex distance after alignment; the unit is the
radius)."""


def _table(rows: list[Row]) -> str:
    below = [f"&#124;∇E&#124; < {bound:.0e}" for bound in _FORCES]
    head = ("", *below, "end: &#124;∇E&#124;", "distance", "steps", "time")
    lines = []
    for row in rows:
        if reason := report.missing(row):
            lines.append([row["case"]["minimiser"], f"*{reason}*", *[""] * (len(head) - 2)])
            continue
        trace = row["trace"]
        best = min(trace, key=lambda point: point["force"])
        reached = [next((point for point in trace if point["force"] < bound), None) for bound in _FORCES]
        lines.append(
            [
                row["case"]["minimiser"],
                *(report.seconds(point["seconds"]) if point else "never" for point in reached),
                report.small(best["force"]),
                report.small(best["distance"]),
                str(best["steps"]),
                report.seconds(best["seconds"]),
            ]
        )
    return report.table(head, lines)
