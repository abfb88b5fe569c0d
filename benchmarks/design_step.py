"""One step of training, value and gradient of the loss through the relaxation: shellkit against triangulax."""

import numpy as np

from . import report
from .case import Case, Row


_LIBRARIES = {
    "shellkit": "shellkit",
    "shellkit-tan": 'shellkit, `form="tan"`',
    "triangulax-published": "triangulax as published",
    "triangulax-cg": "triangulax, CG adjoint",
}
_SCENES = {
    # mesh: (heading, loss, stretch, the peer's limit of steps, memory that its dense adjoint needs in GB)
    "icosphere-1": ("42 vertices, ellipsoid", "ellipsoid", 1.1, 4000, 1.0),
    "icosphere-3": ("642 vertices, ellipsoid", "ellipsoid", 1.1, 4000, 4.0),
    "suzanne": ("Suzanne, 1400 vertices, neo-Hookean, λ = 1.5, sphericity", "sphericity", 1.5, 8000, 15.0),
    "icosphere-4": ("2562 vertices, ellipsoid", "ellipsoid", 1.1, 4000, 48.0),
}
_FIELDS = ("zero", "random")


def cases(quick: bool) -> list[Case]:
    found = []
    for mesh, (_, loss, stretch, max_steps, dense_gb) in _SCENES.items():
        if quick and mesh != "icosphere-1":
            continue
        for field in _FIELDS:
            common = {"mesh": mesh, "loss": loss, "stretch": stretch, "field": field}
            label = f"{mesh} {field}"
            for form in ("sin", "tan") if loss == "sphericity" else ("sin",):
                name = "shellkit" if form == "sin" else "shellkit-tan"
                found.append(Case(f"{label} {name}", "design_step", common | {"form": form, "runs": 9}))
            small = mesh == "icosphere-1"
            for adjoint, name in (("dense", "triangulax-published"), ("cg", "triangulax-cg")):
                dense = adjoint == "dense"
                arguments = {
                    "max_steps": max_steps,
                    "adjoint": adjoint,
                    "forward": not dense,  # the same for both
                    "runs": 5 if small else 1 if dense and mesh == "suzanne" else 3,
                }
                needs_gb = dense_gb if dense else 2.0
                found.append(Case(f"{label} {name}", "peer", common | arguments, of_peer=True, needs_gb=needs_gb))
    return found


def page(rows: list[Row]) -> str:
    sections = []
    for mesh, (heading, *_) in _SCENES.items():
        for field in _FIELDS:
            here = {row["label"].split()[2]: row for row in rows if row["mesh"] == mesh and row["field"] == field}
            if here:
                sections.append(f"### {heading}, director field {field}\n\n{_table(here)}")
    return "\n\n".join([_INTRODUCTION, *sections])


_INTRODUCTION = """\
A design step is the loss and its gradient in all director angles, through the relaxation from rest, as in the tutorial
of triangulax: ellipsoid and Suzanne, thickness 0.1. *As published* is `NonlinearCG(rtol=1e-9, atol=1e-9)` with
optimistix's own adjoint, which builds the Hessian as a dense matrix; *CG adjoint* solves the adjoint system by
conjugate gradients, without a matrix. Times are medians (fastest–slowest), without compilation. The first run holds, for
shellkit, the symbolic factorisation. |∇E| is the Euclidean norm where the relaxation ended, and the energy is counted
from the lowest that any found. Memory is what running adds at its peak. Last: how far the loss's gradient is from that of
shellkit, given where both found the same minimum."""

_HEAD = (
    "",
    "design step",
    "× shellkit",
    "relaxation alone",
    "first run",
    "compilation",
    "steps",
    "factorisations",
    "&#124;∇E&#124;",
    "E − lowest",
    "memory",
    "gradient off by",
)


def _table(here: dict[str, Row]) -> str:
    done = {name: row for name, row in here.items() if not report.missing(row)}
    ours = done.get("shellkit")
    same_energy = [row["energy"] for name, row in done.items() if name != "shellkit-tan"]
    relaxations = {"triangulax-published": done.get("triangulax-cg")}
    lines = []
    for name, title in _LIBRARIES.items():
        if name not in here:
            continue
        row = here[name]
        if reason := report.missing(row):
            lines.append([title, f"*{reason}*", *[""] * (len(_HEAD) - 2)])
            continue
        forward = row.get("forward") or (relaxations.get(name) or {}).get("forward")
        lowest = row["energy"] if name == "shellkit-tan" else min(same_energy)
        lines.append(
            [
                title,
                report.span(row),
                f"{report.three_digits(report.time(row) / report.time(ours))}" if ours else "",
                report.span(forward) if forward else "",
                report.seconds(row["first_s"]),
                report.seconds(row["compile_s"]),
                str(row["steps"]) + ("" if row["converged"] else " (limit)" if "adjoint" in row else " (not converged)"),
                str(row.get("factorisations", "")),
                report.small(row["force_norm"]),
                report.small(row["energy"] - lowest),
                report.megabytes(row["run_mb"]),
                _gradient_error(row, ours) if ours is not None and name.startswith("triangulax") else "",
            ]
        )
    return report.table(_HEAD, lines)


def _gradient_error(row: Row, ours: Row) -> str:
    if abs(row["energy"] - ours["energy"]) > 1e-6 * abs(ours["energy"]):
        return "another minimum"
    theirs, exact = np.array(row["gradient_probes"]), np.array(ours["gradient_probes"])
    return report.small(float(np.linalg.norm(theirs - exact) / np.linalg.norm(exact)))
