"""Scaling: time and memory of every part of a relaxation, from 642 to 163,842 vertices."""

from collections.abc import Callable

import numpy as np

from . import report
from .case import Case, Row


# subdivisions of the icosahedron: memory that the case needs, in GB
_SIZES = {3: 1.0, 4: 1.0, 5: 2.0, 6: 5.0, 7: 18.0}


def cases(quick: bool) -> list[Case]:
    return [
        Case(
            f"icosphere-{level}",
            "scaling",
            {"subdivisions": level, "runs": max(1, 10 // 2 ** (level - 3))},
            needs_gb=needs_gb,
            limit_s=1800.0,
        )
        for level, needs_gb in _SIZES.items()
        if level < 5 or not quick
    ]


def analysis_s(row: Row) -> float:
    """The symbolic factorisation: what the first factorisation takes longer than the others."""
    return max(0.0, row["factorisation"]["first_s"] - report.time(row["factorisation"]))


_PARTS: dict[str, Callable[[Row], float]] = {
    "connectivity": lambda row: row["connectivity_s"],
    "numbering": lambda row: row["numbering_s"],
    "analysis": analysis_s,
    "Hessian": lambda row: report.time(row["assembly"]),
    "factorisation": lambda row: report.time(row["factorisation"]),
    "solve": lambda row: report.time(row["solve"]),
    "relaxation": lambda row: report.time(row["relaxation"]),
}


def page(rows: list[Row]) -> str:
    done = [row for row in rows if not report.missing(row)]
    head = ["", *(f"{row['n_vertices']:,}" for row in done), "exponent"]
    lines = [
        [name, *(report.seconds(part(row)) for row in done), _exponent(done, part)] for name, part in _PARTS.items()
    ]
    lines.append(["steps", *(str(row["steps"]) for row in done), ""])
    lines.append(["factorisations", *(str(row["factorisations"]) for row in done), ""])
    lines.append(["&#124;∇E&#124; at the end", *(report.small(row["force_norm"]) for row in done), ""])
    memory = lambda row: row["memory_mb"]
    lines.append(["memory", *(report.megabytes(memory(row)) for row in done), _exponent(done, memory)])
    lines.append(["compilation", *(report.seconds(row["relaxation"]["compile_s"]) for row in done), ""])
    absent = [f"- {row['label']}: {report.missing(row)}" for row in rows if report.missing(row)]
    return "\n\n".join([_INTRODUCTION, report.table(head, lines), "\n".join(absent)])


def _exponent(rows: list[Row], part: Callable[[Row], float]) -> str:
    """p of the best fit of a power of the number of vertices."""
    if len(rows) < 2:
        return ""
    sizes = np.log([row["n_vertices"] for row in rows])
    return f"{np.polyfit(sizes, np.log([max(part(row), 1e-9) for row in rows]), 1)[0]:.2f}"


_INTRODUCTION = """\
The tutorial's teacher (λ = 1.1, orthogonal layers: the sphere buckles) on icospheres. The mesh's connectivity, the
numbering of unknowns and non-zeros, and the symbolic analysis are done once; the Hessian, its factorisation and a solve
once a step or so. The relaxation is the whole of `problem()` from rest, without compilation. Memory is the largest that
the process used beyond what it had after its imports. The exponent p fits time ∝ (vertices)ᵖ."""
