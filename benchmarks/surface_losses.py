"""Losses between surfaces of different connectivity: value and gradient, with time and memory."""

from . import report
from .case import Case, Row


LOSSES = ("PointToSurface", "Chamfer", "Varifold")
_EDGE = 0.0539  # of triangles that the unit sphere takes ten thousand of


def cases(quick: bool) -> list[Case]:
    return [
        Case(
            f"{loss}{', ICP' if icp else ''}",
            "surface_losses",
            {"loss": loss, "icp": icp, "edge": 0.3 if quick else _EDGE, "runs": 3 if quick else 7},
            needs_gb=2.0,
        )
        for loss in LOSSES
        for icp in (False, True)
    ]


def page(rows: list[Row]) -> str:
    head = ("loss", "alignment", "faces", "value and gradient", "first run", "memory to run", "compilation")
    lines = []
    for row in rows:
        name = row["case"]["loss"]
        align = "ICP" if row["case"]["icp"] else "none"
        if reason := report.missing(row):
            lines.append([name, align, f"*{reason}*", *[""] * (len(head) - 3)])
            continue
        there = row["gradient"]
        memory, first = report.megabytes(there["run_mb"]), report.seconds(there["first_s"])
        faces = f"{row['n_faces'][0]:,} × {row['n_faces'][1]:,}"
        lines.append([name, align, faces, report.span(there), first, memory, report.seconds(there["compile_s"])])
    return f"{_INTRODUCTION}\n\n{report.table(head, lines)}"


_INTRODUCTION = """\
A sphere against an ellipsoid, a little turned, of unrelated triangles: value and gradient in the vertices, without any
relaxation, as given and with the alignment by `ICP` that is the default."""
