"""Accuracy against run time: the error of a mesh, of a relaxation and of a gradient, each over the seconds it takes."""

import statistics
from collections.abc import Iterable

import numpy as np

from . import report
from .case import Case, Row


KINDS = ("R", "X", "J")
CELLS = (4, 8, 16, 32)
BETWEEN = (3, 6, 12, 24)  # with the default form only, so that times are compared at errors that are nearly equal
BENDING = (("free", "sin"), ("free", "tan"), ("free", "theta"), ("average", "sin"), ("average", "tan"))
TOLERANCES = {
    "SparseNewton": (1e-1, 1e-3, 1e-6, 1e-9, 1e-12),
    "NonlinearCG": (1e-3, 1e-5, 1e-7, 1e-9),
    "LBFGS": (1e-3, 1e-5, 1e-7, 1e-9),
}
GRADIENTS = {
    "implicit": (1e-1, 1e-3, 1e-6, 1e-12),
    "differences": (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7),
    "unrolled": (50, 100, 200, 400, 800),
}
PEER_TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-9)
_PEER_STEPS, _ROLL_STEPS = 20_000, 100_000


def cases(quick: bool) -> list[Case]:
    kinds, cells = (("J",), CELLS[:1]) if quick else (KINDS, sorted(CELLS + BETWEEN))
    runs = 1 if quick else 5
    found = []
    for kind in kinds:
        for n in cells:
            mesh = f"sheet-{kind}{n}"
            for directors, form in BENDING:
                if n in BETWEEN and form != "sin":
                    continue
                arguments = {"mesh": mesh, "form": form, "directors": directors, "minimiser": "SparseNewton"}
                found.append(_ours(f"mesh {mesh} {directors} {form}", "mesh", runs, arguments))
            if n in CELLS[:-1]:
                slow = {"mesh": mesh, "form": "sin", "directors": "average", "minimiser": "NonlinearCG"}
                found.append(_ours(f"mesh {mesh} average sin NonlinearCG", "mesh", 0, slow))
                peer = {"mesh": mesh, "max_steps": _ROLL_STEPS, "runs": 0}
                found.append(Case(f"mesh {mesh} triangulax", "accuracy_peer", peer, of_peer=True))
    sphere = "icosphere-1" if quick else "icosphere-3"
    for minimiser, tolerances in TOLERANCES.items():
        for tolerance in tolerances[-1:] if quick else tolerances:
            arguments = {"mesh": sphere, "minimiser": minimiser, "tolerance": tolerance}
            found.append(_ours(f"solver {minimiser} {tolerance:g}", "solver", runs, arguments))
    for tolerance in PEER_TOLERANCES[-1:] if quick else PEER_TOLERANCES:
        found.append(_peer(f"solver triangulax {tolerance:g}", sphere, "cg", tolerance, 1))
    for method, parameters in GRADIENTS.items():
        for parameter in parameters[-1:] if quick else parameters:
            arguments = {"mesh": "icosphere-1", "method": method, "parameter": parameter}
            found.append(
                _ours(f"gradient {method} {parameter:g}", "gradient", 1 if method != "implicit" else 9, arguments)
            )
    for adjoint in ("dense", "cg"):
        for tolerance in PEER_TOLERANCES[-1:] if quick else PEER_TOLERANCES:
            found.append(_peer(f"gradient triangulax {adjoint} {tolerance:g}", "icosphere-1", adjoint, tolerance, 3))
    return found


def _ours(label: str, what: str, runs: int, arguments: dict) -> Case:
    return Case(label, "accuracy", {"what": what, "runs": runs, **arguments}, needs_gb=2.0)


def _peer(label: str, mesh: str, adjoint: str, tolerance: float, runs: int) -> Case:
    arguments = {
        "mesh": mesh,
        "loss": "ellipsoid",
        "stretch": 1.1,
        "max_steps": _PEER_STEPS,
        "field": "random",
        "adjoint": adjoint,
        "forward": True,
        "runs": runs,
        "tolerance": tolerance,
    }
    return Case(label, "peer", arguments, of_peer=True, needs_gb=3.0)


def _error(found: list[float], exact: list[float]) -> float:
    """The largest difference between the distances of a few pairs of vertices."""
    return float(np.abs(np.subtract(found, exact)).max())


def meshes(rows: list[Row]) -> dict[tuple[str, str], list[tuple[int, float, float, Row]]]:
    """For each kind of mesh and each method its cells, errors and seconds, from coarse to fine."""
    curves: dict[tuple[str, str], list[tuple[int, float, float, Row]]] = {}
    for row in rows:
        if row["label"].startswith("mesh ") and not report.missing(row):
            _, mesh, *method = row["label"].split()
            error = _error(row["shape_probes"], row["exact_probes"])
            point = (int(mesh[len("sheet-") + 1 :]), error, report.time(row), row)
            curves.setdefault((mesh[len("sheet-")], " ".join(method)), []).append(point)
    return {key: sorted(curve, key=lambda point: point[0]) for key, curve in curves.items()}


def solvers(rows: list[Row]) -> dict[str, list[tuple[float, float, float, Row]]]:
    """For each minimiser its tolerances, the errors of the shape and the seconds."""
    return _against(rows, "solver ", "shape_probes", "solver SparseNewton", _error)


def gradients(rows: list[Row]) -> dict[str, list[tuple[float, float, float, Row]]]:
    """For each way to a gradient its parameter, the relative errors and the seconds."""
    distance = lambda a, b: float(np.linalg.norm(np.subtract(a, b)) / np.linalg.norm(b))
    return _against(rows, "gradient ", "gradient_probes", "gradient implicit", distance)


def _against(rows: list[Row], prefix: str, key: str, reference: str, distance):
    """Errors against the tightest of the reference's own rows, itself left out."""
    done = [row for row in rows if row["label"].startswith(prefix) and not report.missing(row)]
    exact = [row for row in done if row["label"].startswith(reference)]
    curves: dict[str, list[tuple[float, float, float, Row]]] = {}
    if not exact:
        return curves
    best = min(exact, key=lambda row: float(row["label"].split()[-1]))
    for row in done:
        if row is not best:
            *method, parameter = row["label"][len(prefix) :].split()
            seconds = report.time(row["forward"] if prefix == "solver " and "forward" in row else row)
            point = (float(parameter), distance(row[key], best[key]), seconds, row)
            curves.setdefault(" ".join(method), []).append(point)
    return curves


def claims(rows: list[Row]) -> list[str]:
    """What free directors cost at equal mesh, and what they win at equal error."""
    curves, lines = meshes(rows), []
    ratios = [
        ours[2] / theirs[2]
        for kind in KINDS
        for ours, theirs in zip(curves.get((kind, "free sin"), []), curves.get((kind, "average sin"), []), strict=False)
    ]
    if ratios:
        lines.append(
            f"Free directors take {statistics.median(ratios):.1f} times as long as averaged normals on the same mesh "
            f"({min(ratios):.1f} to {max(ratios):.1f})."
        )
    for kind in KINDS:
        free, average = curves.get((kind, "free sin"), []), curves.get((kind, "average sin"), [])
        if free and average:
            cells, error, seconds, _ = min(average, key=lambda point: point[1])
            reached = next((point for point in free if point[1] <= error), None)
            if reached is not None:
                lines.append(
                    f"On {kind}, the best that averaged normals reach is an error of {error:.1e}, in "
                    f"{report.seconds(seconds)} with {cells} cells a side; free directors fall below it with "
                    f"{reached[0]} cells in {report.seconds(reached[2])}, {seconds / reached[2]:.1f} times as fast."
                )
            finest = free[-1]
            lines.append(
                f"On {kind} with {finest[0]} cells, free directors are off by {finest[1]:.1e}, averaged normals by "
                f"{average[-1][1]:.1e}."
            )
    return lines


def page(rows: list[Row]) -> str:
    parts = ["\n".join(f"- {line}" for line in claims(rows))]
    lines = [
        [kind, method, str(cells), report.small(error), report.seconds(seconds), _steps(row)]
        for (kind, method), curve in meshes(rows).items()
        for cells, error, seconds, row in curve
    ]
    parts.append("### Of a mesh\n\n" + _MESHES)
    parts.append(report.table(("mesh", "bending, minimiser", "cells", "error", "time", "steps"), lines))
    parts.append("### Of a relaxation\n\n" + _SOLVERS)
    parts.append(_table("tolerance", solvers(rows)))
    parts.append("### Of a gradient\n\n" + _GRADIENTS)
    parts.append(_table("tolerance, step or number of steps", gradients(rows)))
    return "\n\n".join(parts + _unmeasured(rows))


_MESHES = """\
A unit square, h = 0.02, E = 1, ν = 0.3, that would like to roll up into a cylinder about an axis 30° askew to its
edges, from flat. The error is the largest difference between 64 distances of vertices and those on the cylinder.
triangulax, and its minimiser in shellkit, at the tutorial's tolerance of 1e-9."""
_SOLVERS = """\
The ellipsoid problem at random directors, 642 vertices, λ = 1.1: error of the relaxed shape, the largest difference
between 64 distances of vertices and those of SparseNewton at its tightest. What is called a tolerance means something
else for each minimiser."""
_GRADIENTS = """\
The gradient of the ellipsoid problem's loss in all 160 director angles, 42 vertices: relative error along 16 random
directions, against the implicit gradient at the tightest tolerance. Differences are central and take 320 relaxations;
unrolled is differentiated through so many steps of nonlinear conjugate gradients. *None*: the relaxation stopped too
far from equilibrium for the equation of the adjoint to be solved, and the gradient is not a number rather than a wrong
one."""


def _table(parameter: str, curves: dict[str, list[tuple[float, float, float, Row]]]) -> str:
    lines = [
        [method, f"{value:g}", report.small(error) if error == error else "none", report.seconds(seconds), _steps(row)]
        for method, curve in curves.items()
        for value, error, seconds, row in curve
    ]
    return report.table(("", parameter, "error", "time", "steps"), lines)


def _steps(row: Row) -> str:
    if "steps" not in row:
        return ""
    return f"{row['steps']}{'' if row.get('converged', True) else ', not converged'}"


def _unmeasured(rows: Iterable[Row]) -> list[str]:
    reasons = [f"{row['label']}: {reason}" for row in rows if (reason := report.missing(row))]
    return ["Not measured: " + "; ".join(reasons) + "."] if reasons else []
