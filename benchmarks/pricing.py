"""Pricing: what each part of a scene costs, from the matrix to the gradient of a loss."""

from collections.abc import Callable

from . import report
from .case import Case, Row


# The scenes of benchmarks.workers.pricing, and what they are called; each is the second one with something changed.
SCENES = {
    "stretching": "stretching only",
    "bending": "stretching and bending, free in space",
    "tan": '`form="tan"`',
    "free directors": "free directors",
    "neo-Hookean": "neo-Hookean",
    "bilayer": "two nematic layers in place of growth",
    "pressure": "pressure, which follows",
    "volume": "a held volume",
    "six held": "six coordinates held: no free motions",
    "clamped": "a clamped cap",
    "gravity": "a clamped cap and gravity",
    "contact": "a clamped cap, gravity, a plane to lean on",
    "unaligned": "a loss without alignment",
    "fit": "a step of `fit`, with its history",
}
_SIZES = {"icosphere-3": "642 vertices", "icosphere-4": "2562 vertices"}
_LARGE = ("stretching", "bending", "free directors", "volume", "clamped")


def cases(quick: bool) -> list[Case]:
    return [
        Case(f"{mesh} {scene}", "pricing", {"mesh": mesh, "scene": scene, "runs": 3 if quick else 9})
        for mesh in (("icosphere-1",) if quick else _SIZES)
        for scene in (_LARGE if mesh == "icosphere-4" else SCENES)
    ]


def page(rows: list[Row]) -> str:
    sections = []
    for mesh in dict.fromkeys(row["case"]["mesh"] for row in rows):
        here = [row for row in rows if row["case"]["mesh"] == mesh]
        sections.append(f"### A sphere of {_SIZES.get(mesh, mesh)}\n\n{_table(here)}")
    return "\n\n".join([_INTRODUCTION, *sections])


_INTRODUCTION = """\
A sphere that grows unevenly (1.1 ± 0.05), with a loss that is aligned to its target, and what each part of a scene adds
to that or takes away. *Non-zeros* are those of the upper half of the Hessian. *Derivatives* are energy, gradient and
Hessian in one call; the factorisation is of that Hessian, its symbolic analysis done before. The relaxation is the
whole of `problem()` from rest; the gradient is that of the loss in the growth (or the angles) of every face, relaxation
included. In brackets: the time over that of the second line."""


_PARTS: tuple[tuple[str, Callable[[Row], float]], ...] = tuple(
    (name, lambda row, key=key: report.time(row[key]))
    for name, key in (
        ("derivatives", "derivatives"),
        ("factorisation", "factorisation"),
        ("relaxation", "relaxation"),
        ("loss and gradient", "gradient"),
    )
)


def _table(rows: list[Row]) -> str:
    head = ("", "unknowns", "non-zeros", *(name for name, _ in _PARTS), "steps")
    done = {row["case"]["scene"]: row for row in rows if not report.missing(row)}
    whole = done.get("bending")
    lines = []
    for row in rows:
        scene = row["case"]["scene"]
        name = SCENES[scene] if scene in ("stretching", "bending", "fit") else f"… {SCENES[scene]}"
        if reason := report.missing(row):
            lines.append([name, f"*{reason}*", *[""] * (len(head) - 2)])
            continue
        cells = [name]
        for key in ("unknowns", "nonzeros"):
            cells.append(_share(row[key], whole and whole[key], "{:,}".format) if key in row else "")
        for name, part in _PARTS:
            known = whole and part(whole)
            measured = name == "loss and gradient" or "relaxation" in row
            cells.append(_share(part(row), known, report.seconds) if measured else "")
        failed = "" if row.get("converged", True) else ", not converged"
        lines.append([*cells, f"{row.get('steps', '')}{failed}"])
    return report.table(head, lines)


def _share(value: float, whole: float | None, show: Callable) -> str:
    """A figure, and what it is of that of the whole scene."""
    return show(value) if not whole or value == whole else f"{show(value)} ({value / whole:.2f})"
