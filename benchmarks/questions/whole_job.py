"""What a user waits for: whole processes, from starting Python to the final shape, beside triangulax."""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from typing import Any, NamedTuple

from .. import results, tables
from ..case import Case, Row


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
    found, module = [], "questions.whole_job"
    for mesh, job in list(_JOBS.items())[: 1 if quick else None]:
        ours = {"mesh": mesh, "steps": job.steps, "runs": 1 if quick else 3, "job": "ours", "warm": False}
        theirs = ours | {"job": "peers", "adjoint": job.adjoint}
        found.append(Case(f"{mesh} cold", module, ours))
        found.append(Case(f"{mesh} triangulax", module, theirs, of_peer=True, needs_gb=4.0))
        found.append(Case(f"{mesh} warm", module, ours | {"warm": True}))
    return found


def measure(mesh: str, job: str, steps: int, runs: int, warm: bool, adjoint: str | None = None) -> dict[str, Any]:
    """Start `benchmarks.jobs.<job>` so many times, with an empty cache of compiled programs or, `warm`, with that of a
    run before, which does not count."""
    arguments = [sys.executable, "-m", f"benchmarks.jobs.{job}", mesh, str(steps)]
    arguments += [] if adjoint is None else [adjoint]
    with tempfile.TemporaryDirectory() as folder:
        kept = {"JAX_COMPILATION_CACHE_DIR": folder, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.1"}
        settings = kept if warm else {}
        if warm:
            _run(arguments, settings)
        marks = [_run(arguments, settings) for _ in range(runs)]
    return {"marks": {name: [found[name] for found in marks] for name in marks[0]}}


def _run(arguments: list[str], settings: dict[str, str]) -> dict[str, float]:
    started = time.time()
    done = subprocess.run(arguments, env=os.environ | settings, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    return {line["mark"]: round(line["time"] - started, 3) for line in lines}


def summary(row: Row, raw: dict[str, Row]) -> Row:
    """The median of each mark over the runs, the earliest and the latest."""
    short = {key: value for key, value in row.items() if key != "marks"}
    for part, pick in (("median_s", statistics.median), ("earliest_s", min), ("latest_s", max)):
        short[part] = {name: pick(times) for name, times in row.get("marks", {}).items()}
    return results.compact(short)


def page(rows: list[Row]) -> str:
    """Seconds after the start of Python, medians."""
    known = {row["label"]: row for row in rows}
    titles = {}
    for mesh, job in _JOBS.items():
        titles[f"{mesh} cold"] = f"{job.title}: shellkit"
        titles[f"{mesh} warm"] = f"{job.title}: shellkit, cache of an earlier run"
        theirs = "as published" if job.adjoint == "dense" else "CG adjoint"
        titles[f"{mesh} triangulax"] = f"{job.title}: triangulax, {theirs}"
    here = [known[label] for label in titles if label in known]
    cells = lambda row: [f"{row['median_s'][mark]:.1f} s" if mark in row["median_s"] else "" for mark in _MARKS]
    return tables.of_rows(("ellipsoid", *_MARKS), here, lambda row: [titles[row["label"]]], cells)


def overview(rows: list[Row]) -> str:
    """The table of the README."""
    machines = ", ".join(dict.fromkeys(row["machine"]["cpu"] for row in rows))
    return f"{page(rows)}\n\n*{machines}; {tables.days(rows)}, {tables.commits(rows)}; medians of three.*"
