"""Platforms: kernels and relaxations on the processor and on a GPU, with the linear solvers that each can use."""

from . import report
from .case import Case, Row


_SOLVERS = {"cpu": ("pardiso", "superlu"), "cuda": ("superlu", "cg")}
_NAMES = {"cpu": "processor", "cuda": "GPU"}


def cases(quick: bool) -> list[Case]:
    levels = (3, 4) if quick else (3, 4, 5, 6)
    kernels = [
        Case(
            f"{platform} kernels-{level}",
            "platforms",
            {"subdivisions": level, "solver": None, "runs": 20},
            platform=platform,
        )
        for platform in _SOLVERS
        for level in ((3,) if quick else (3, 5, 7))
    ]
    relaxations = [
        Case(
            f"{platform} {solver}-{level}",
            "platforms",
            {"subdivisions": level, "solver": solver, "runs": 3},
            platform=platform,
            limit_s=60.0 if quick else 150.0,
        )
        for platform, solvers in _SOLVERS.items()
        for solver in solvers
        for level in levels
        if solver != "superlu" or level < 6
    ]
    return kernels + relaxations


def page(rows: list[Row]) -> str:
    kernels = [row for row in rows if row["case"]["solver"] is None]
    relaxations = [row for row in rows if row["case"]["solver"] is not None]
    return "\n\n".join([_INTRODUCTION, _kernels(kernels), _RELAXATIONS, _relaxations(relaxations)])


def _kernels(rows: list[Row]) -> str:
    head = ("", "vertices", "energy and gradient", "with the Hessian", "µs a face")
    lines = []
    for row in rows:
        if reason := report.missing(row):
            lines.append([_NAMES[row["platform"]], f"*{reason}*", "", "", ""])
            continue
        second = report.time(row["kernels"]["derivatives"])
        lines.append(
            [
                f"{_NAMES[row['platform']]}: {row['device']}",
                f"{row['n_vertices']:,}",
                report.seconds(report.time(row["kernels"]["gradient"])),
                report.seconds(second),
                f"{1e6 * second / row['n_faces']:.3g}",
            ]
        )
    return report.table(head, lines)


def _relaxations(rows: list[Row]) -> str:
    head = ("", "solver", "vertices", "relaxation", "steps", "factorisations", "&#124;∇E&#124;", "compilation")
    lines = []
    for row in rows:
        start = [_NAMES[row["platform"]], f"`{row['case']['solver']}`"]
        if reason := report.missing(row):
            lines.append([*start, f"*{reason}*", *[""] * (len(head) - 3)])
            continue
        lines.append(
            [
                *start,
                f"{row['n_vertices']:,}",
                report.seconds(report.time(row)) + ("" if row["converged"] else " (not converged)"),
                str(row["steps"]),
                str(row["factorisations"]),
                report.small(row["force_norm"]),
                report.seconds(row["compile_s"]),
            ]
        )
    return report.table(head, lines)


_INTRODUCTION = """\
The energy of a deformed sphere with its gradient, and with both its exact sparse Hessian, on the processor and on a
GPU; medians, without compilation."""

_RELAXATIONS = """\
The tutorial's teacher, relaxed from rest. On a GPU `superlu` hands each matrix to the host and factorises it there;
`cg` stays on the device, with the inverse diagonal blocks as preconditioner."""
