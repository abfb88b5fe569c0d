"""What a user waits for: whole processes, from starting Python to the final shape, beside triangulax."""

import statistics
from typing import NamedTuple

from . import report
from .case import Case, Row


class Job(NamedTuple):
    """The ellipsoid on a mesh, and the peer's adjoint that is fastest there."""

    title: str
    steps: int
    adjoint: str


_JOBS = {
    "icosphere-1": Job("42 vertices, 200 steps", 200, "dense"),
    "icosphere-3": Job("642 vertices, 100 steps", 100, "cg"),
}
_MARKS = ("imported", "problem built", "first design step", "all steps", "final shape")


def cases(quick: bool) -> list[Case]:
    found = []
    for mesh, job in _JOBS.items():
        if quick and mesh != "icosphere-1":
            continue
        common = {"mesh": mesh, "steps": job.steps, "runs": 1 if quick else 3}
        ours = common | {"job": "ours"}
        theirs = common | {"job": "peers", "warm": False, "adjoint": job.adjoint}
        found.append(Case(f"{mesh} cold", "whole_job", ours | {"warm": False}))
        found.append(Case(f"{mesh} triangulax", "whole_job", theirs, of_peer=True, needs_gb=4.0))
        found.append(Case(f"{mesh} warm", "whole_job", ours | {"warm": True}))
    return found


def table(rows: list[Row]) -> str:
    """Seconds after the start of Python, medians."""
    lines = []
    for mesh, job in _JOBS.items():
        here = {row["label"].split()[1]: row for row in rows if row["case"]["mesh"] == mesh}
        for name, title in (
            ("cold", "shellkit"),
            ("warm", "shellkit, cache of an earlier run"),
            ("triangulax", f"triangulax, {'as published' if job.adjoint == 'dense' else 'CG adjoint'}"),
        ):
            if name in here:
                lines.append([f"{job.title}: {title}", *_seconds(here[name])])
    return report.table(("ellipsoid", *_MARKS), lines)


def _seconds(row: Row) -> list[str]:
    if reason := report.missing(row):
        return [f"*{reason}*"] + [""] * (len(_MARKS) - 1)
    return [f"{statistics.median(row['marks'][mark]):.1f} s" if mark in row["marks"] else "" for mark in _MARKS]


def page(rows: list[Row]) -> str:
    return f"{_INTRODUCTION}\n\n{table(rows)}"


_INTRODUCTION = """\
Whole processes, one after another: seconds after Python was started, medians of three. The first row compiles
everything; *cache of an earlier run* has JAX's persistent cache, as the examples do. The peer's design step contains
its relaxation, so that its final shape comes with the last step."""
