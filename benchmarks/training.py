"""Training: the loss against relaxations and against seconds, for Adam, L-BFGS and Levenberg–Marquardt."""

from typing import NamedTuple

from . import report
from .case import Case, Row


class Scene(NamedTuple):
    """What is trained on a mesh."""

    mesh: str
    name: str
    steps: dict[str, int]


_OPTIMISERS = {"adam": "Adam", "lbfgs": "L-BFGS", "levenberg": "Levenberg–Marquardt"}
SCENES = {
    "teacher": Scene("icosphere-1", "Teacher, 42 vertices", {"adam": 200, "lbfgs": 60, "levenberg": 30}),
    "ellipsoid": Scene("icosphere-3", "Ellipsoid, 642 vertices", {"adam": 100, "lbfgs": 40, "levenberg": 20}),
    "suzanne": Scene("suzanne", "Suzanne to a sphere, 1400 vertices", {"adam": 200, "lbfgs": 100, "levenberg": 60}),
}
_PARTS = (0.5, 0.9, 1.0)


def cases(quick: bool) -> list[Case]:
    return [
        Case(
            f"{scene} {optimiser}",
            "training",
            {
                "mesh": "icosphere-1" if quick else SCENES[scene].mesh,
                "scene": scene,
                "optimiser": optimiser,
                "steps": 5 if quick else SCENES[scene].steps[optimiser],
                "limit_s": 20.0 if quick else 180.0,
            },
        )
        for scene in SCENES
        for optimiser in _OPTIMISERS
        # The head is no head on a sphere.
        if not (quick and scene == "suzanne")
    ]


def page(rows: list[Row]) -> str:
    sections = [_INTRODUCTION]
    for key, scene in SCENES.items():
        here = [row for row in rows if row["case"]["scene"] == key]
        if here:
            sections.append(f"### {scene.name}\n\n{_table(here)}")
    return "\n\n".join(sections)


_INTRODUCTION = """\
From all director angles at zero. Times are without compilation; relaxations are those of line searches and of refused
steps, too. A level is part of the way from the loss at the start to the loss that Adam ends with: the first relaxation,
and time, at which a method is there. The sphere is relaxed from rest in every step, with Adam at the rate of 0.1;
Suzanne with the tutorial's loss, trained as in `examples/suzanne.py`: form `tan`, each relaxation from the last
equilibrium, Adam's gradient clipped and its rate falling from 0.15, and Levenberg and Marquardt allowed to climb to
three times the loss."""


def _table(rows: list[Row]) -> str:
    levels = [f"{100 * part:.0f} % of Adam's descent" for part in _PARTS]
    head = ("", *levels, "loss at the end", "steps", "relaxations", "time", "compilation and first step")
    adam = next((row for row in rows if row["case"]["optimiser"] == "adam" and not report.missing(row)), None)
    lines = []
    for row in rows:
        name = _OPTIMISERS[row["case"]["optimiser"]]
        if reason := report.missing(row):
            lines.append([name, f"*{reason}*", *[""] * (len(head) - 2)])
            continue
        trace = row["trace"]
        last = trace[-1]
        end = f"{min(point['loss'] for point in trace):.3g}"
        reached = [""] * len(_PARTS) if adam is None else [_reached(trace, adam["trace"], part) for part in _PARTS]
        counts = (str(last["step"]), str(last["relaxations"]), report.seconds(last["seconds"]))
        lines.append([name, *reached, end, *counts, report.seconds(row["first_s"])])
    return report.table(head, lines)


def _reached(trace: list[Row], adam: list[Row], part: float) -> str:
    start, end = adam[0]["loss"], min(point["loss"] for point in adam)
    level = start - part * (start - end)
    found = next((point for point in trace if point["loss"] <= level * (1 + 1e-9)), None)
    return "never" if found is None else f"{found['relaxations']}, {report.seconds(found['seconds'])}"
