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
            f"icosphere-{level} {what}",
            "scaling",
            {"subdivisions": level, "what": what, "runs": max(1, 12 // 2 ** (level - 3))},
            needs_gb=needs_gb,
            limit_s=1800.0,
        )
        for level, needs_gb in _SIZES.items()
        for what in ("parts", "relaxation")
        if level < 5 or not quick
    ]


_PARTS: dict[str, Callable[[Row], float]] = {
    "connectivity of the mesh": lambda row: row["connectivity_s"],
    "numbering and sparsity": lambda row: row["numbering_s"],
    "analysis": lambda row: row["factorisation"]["first_s"] - report.time(row["factorisation"]),
    "Hessian": lambda row: report.time(row["assembly"]),
    "factorisation": lambda row: report.time(row["factorisation"]),
    "solve": lambda row: report.time(row["solve"]),
}


_FACTS: tuple[tuple[str, str, Callable[[float], str]], ...] = (
    ("steps", "steps", str),
    ("factorisations", "factorisations", str),
    ("&#124;∇E&#124; at the end", "force_norm", report.small),
    ("compilation", "compile_s", report.seconds),
)


def memory(row: Row) -> float:
    """What a relaxation needs at its peak, and the problem itself, in MB."""
    return row["run_mb"] + row["problem_mb"]


def times(rows: list[Row]) -> dict[str, tuple[list[int], list[float]]]:
    """For every part, and for the relaxation as a whole, the numbers of vertices and the seconds."""
    parts, wholes = _done(rows, "parts"), _done(rows, "relaxation")
    vertices = [row["n_vertices"] for row in parts]
    found = {name: (vertices, [part(row) for row in parts]) for name, part in _PARTS.items()}
    return found | {"relaxation": ([row["n_vertices"] for row in wholes], [report.time(row) for row in wholes])}


def page(rows: list[Row]) -> str:
    wholes = _done(rows, "relaxation")
    sizes = sorted({row["n_vertices"] for row in rows if not report.missing(row)})
    lines = [_line(name, sizes, *series, report.seconds) for name, series in times(rows).items()]
    vertices = [row["n_vertices"] for row in wholes]
    lines.append(_line("memory", sizes, vertices, [memory(row) for row in wholes], report.megabytes))
    for name, key, show in _FACTS:
        lines.append([*_line(name, sizes, vertices, [row[key] for row in wholes], show)[:-1], ""])
    absent = [f"- {row['label']}: {report.missing(row)}" for row in rows if report.missing(row)]
    head = ["", *(f"{size:,} vertices" for size in sizes), "exponent"]
    return "\n\n".join([_INTRODUCTION, report.table(head, lines), "\n".join(absent)])


def _done(rows: list[Row], what: str) -> list[Row]:
    return [row for row in rows if row["case"]["what"] == what and not report.missing(row)]


def _line(
    name: str, sizes: list[int], vertices: list[int], values: list[float], show: Callable[[float], str]
) -> list[str]:
    """A line of the table: a value for each size there is one for, and the exponent of the best power of the size."""
    known = dict(zip(vertices, values, strict=True))
    exponent = ""
    if len(known) > 1 and min(values) > 0:
        exponent = f"{np.polyfit(np.log(vertices), np.log(values), 1)[0]:.2f}"
    return [name, *(show(known[size]) if size in known else "" for size in sizes), exponent]


_INTRODUCTION = """\
The tutorial's teacher (λ = 1.1, orthogonal layers: the sphere buckles) on icospheres. The mesh's connectivity, the
numbering of unknowns and non-zeros, and the symbolic analysis are done once; the Hessian, its factorisation and a solve
once a step or so. The relaxation is the whole of `problem()` from rest, without compilation and analysis. Memory is the
peak of a relaxation, problem and factor included, beyond what imports and compilation left. The exponent p fits
(vertices)ᵖ."""
