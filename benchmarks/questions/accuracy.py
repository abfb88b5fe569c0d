"""Accuracy against run time: the error of a mesh, of a relaxation and of a gradient, each over the seconds it takes."""

import itertools
import statistics
from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

import shellkit as sk

from .. import results, tables
from ..case import Case, Row
from ..measure import profile
from ..problems import design_problem, director_angles, ending, gradient_in, relaxed, rolling
from ..tutorial import gradient_probes, rolled, shape_probes


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
_MAX_STEPS, _ROLL_STEPS = 20_000, 100_000


def cases(quick: bool) -> list[Case]:
    some = lambda values: values[-1:] if quick else values
    sphere, runs, found = "icosphere-1" if quick else "icosphere-3", 1 if quick else 5, []

    def ours(label: str, runs: int, **arguments: Any) -> None:
        arguments = {"what": label.split()[0], "runs": runs, **arguments}
        found.append(Case(label, "questions.accuracy", arguments, needs_gb=2.0))

    def peer(label: str, mesh: str, adjoint: str, runs: int, tolerance: float) -> None:
        scene = {"mesh": mesh, "loss": "ellipsoid", "stretch": 1.1, "field": "random", "max_steps": _MAX_STEPS}
        arguments = scene | {"adjoint": adjoint, "forward": True, "runs": runs, "tolerance": tolerance}
        found.append(Case(label, "peer", arguments, of_peer=True, needs_gb=3.0))

    for kind, n in itertools.product(some(KINDS), CELLS[:1] if quick else sorted(CELLS + BETWEEN)):
        mesh = f"sheet-{kind}{n}"
        for directors, form in BENDING:
            if n in CELLS or form == "sin":
                scene = {"mesh": mesh, "form": form, "directors": directors, "minimiser": "SparseNewton"}
                ours(f"mesh {mesh} {directors} {form}", runs, **scene)
        if n in CELLS[:-1]:
            slow = {"mesh": mesh, "form": "sin", "directors": "average", "minimiser": "NonlinearCG"}
            ours(f"mesh {mesh} average sin NonlinearCG", 0, **slow)
            arguments = {"mesh": mesh, "max_steps": _ROLL_STEPS, "runs": 0}
            found.append(Case(f"mesh {mesh} triangulax", "peer", arguments, "roll", of_peer=True))
    for minimiser, tolerances in TOLERANCES.items():
        for tolerance in some(tolerances):
            ours(f"solver {minimiser} {tolerance:g}", runs, mesh=sphere, minimiser=minimiser, tolerance=tolerance)
    for tolerance in some(PEER_TOLERANCES):
        peer(f"solver triangulax {tolerance:g}", sphere, "cg", 1, tolerance)
    for method, parameters in GRADIENTS.items():
        for parameter in some(parameters):
            often = 9 if method == "implicit" else 1
            ours(f"gradient {method} {parameter:g}", often, mesh="icosphere-1", method=method, parameter=parameter)
    for adjoint in ("dense", "cg"):
        for tolerance in some(PEER_TOLERANCES):
            peer(f"gradient triangulax {adjoint} {tolerance:g}", "icosphere-1", adjoint, 3, tolerance)
    return found


def _by(minimiser: str, tolerance: float, max_steps: int) -> dict[str, Any]:
    """How a problem is relaxed."""
    if minimiser == "SparseNewton":
        return {"solver": sk.SparseNewton(rtol=tolerance)}
    method = {"NonlinearCG": optx.NonlinearCG, "LBFGS": optx.LBFGS}[minimiser]
    return {"solver": method(rtol=tolerance, atol=tolerance), "max_steps": max_steps}


def measure(what: str, mesh: str, runs: int, **arguments: Any) -> dict:
    """One point of a figure: `"mesh"`, `"solver"` or `"gradient"`."""
    part = {"mesh": _of_mesh, "solver": _of_solver, "gradient": _of_gradient}[what]
    return part(sk.Mesh.read(mesh), runs, **arguments)


def _of_mesh(mesh: sk.Mesh, runs: int, form: str, directors: str, minimiser: str) -> dict:
    method = _by(minimiser, 1e-11 if minimiser == "SparseNewton" else 1e-9, _ROLL_STEPS)
    found, record = profile(relaxed, rolling(mesh, form=form, directors=directors, **method), runs=runs)
    probes = {"shape_probes": shape_probes(found.vertices), "exact_probes": shape_probes(rolled(mesh.vertices))}
    return record | ending(found) | probes


def _of_solver(mesh: sk.Mesh, runs: int, minimiser: str, tolerance: float) -> dict:
    problem = design_problem(mesh, "ellipsoid", 1.1, "random", **_by(minimiser, tolerance, _MAX_STEPS))
    found, record = profile(relaxed, problem, runs=runs)
    return record | ending(found) | {"shape_probes": shape_probes(found.vertices)}


def _of_gradient(mesh: sk.Mesh, runs: int, method: str, parameter: float) -> dict:
    """`parameter` is the tolerance of the relaxation, the step of the differences, or the steps that are unrolled."""
    tolerance = parameter if method == "implicit" else 1e-11
    problem = design_problem(mesh, "ellipsoid", 1.1, "random", solver=sk.SparseNewton(rtol=tolerance))
    gradient = {"implicit": _implicit, "differences": _differences, "unrolled": _unrolled}[method]
    found, record = profile(partial(gradient, parameter), problem, runs=runs)
    return record | {"gradient_probes": gradient_probes(found)}


def _implicit(_, problem: sk.InverseProblem):
    return gradient_in(director_angles)(problem)[1]


def _differences(step: float, problem: sk.InverseProblem):
    """Central differences in every angle, one after another."""
    angles = director_angles(problem)
    flat = jnp.concatenate(angles)

    def loss(values):
        return eqx.tree_at(director_angles, problem, tuple(jnp.split(values, 2))).evaluate()[0]

    def slope(index):
        direction = jnp.zeros_like(flat).at[index].set(step)
        return (loss(flat + direction) - loss(flat - direction)) / (2 * step)

    return tuple(jnp.split(jax.lax.map(slope, jnp.arange(len(flat))), 2))


def _unrolled(steps: float, problem: sk.InverseProblem):
    """Through so many steps of conjugate gradients."""

    def loss(angles):
        changed = eqx.tree_at(director_angles, problem, angles)
        energy = lambda vertices, moved: moved.total_energy(vertices)
        options = {"max_steps": int(steps), "adjoint": optx.RecursiveCheckpointAdjoint(), "throw": False}
        method = optx.NonlinearCG(rtol=0.0, atol=0.0)
        found = optx.minimise(energy, method, problem.mesh.vertices, changed, **options)
        shape = eqx.tree_at(lambda e: e.vertices, changed.unrelaxed(), found.value)
        assert problem.loss is not None
        return problem.loss.evaluate(shape, changed.actuation)[0]

    return jax.grad(loss)(director_angles(problem))


_KEPT = ("label", "date", "load", "commit", "stored_in", "machine", "threads", "platform", "versions")
_KEPT += ("steps", "converged", "force_norm", "median_s", "span_s", "samples", "compile_s", "run_mb", "forward")


def summary(row: Row, raw: dict[str, Row]) -> Row:
    """With the error: of a mesh against the exact shape, of the others against the reference, if that was measured."""
    short = {key: value for key, value in results.compact(row).items() if key in (*_KEPT, "skipped", "failed")}
    if "forward" in row:
        short["forward"] = {"median_s": short["forward"]["median_s"]}
    what = row["label"].split()[0]
    key = "gradient_probes" if what == "gradient" else "shape_probes"
    reference = {
        "mesh": {key: row.get("exact_probes")},
        "solver": raw.get(f"solver SparseNewton {min(TOLERANCES['SparseNewton']):g}", {}),
        "gradient": raw.get(f"gradient implicit {min(GRADIENTS['implicit']):g}", {}),
    }[what]
    if tables.missing(row) or key not in reference or reference is row:
        return short
    apart, exact = np.subtract(row[key], reference[key]), reference[key]
    error = np.linalg.norm(apart) / np.linalg.norm(exact) if what == "gradient" else np.abs(apart).max()
    return short | results.compact({"error": float(error)})


def curves(rows: list[Row], what: str) -> dict[str, list[Row]]:
    """For each method the rows that have an error, by its cells, tolerance or other parameter."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        kind, first, *others = row["label"].split()
        if kind == what and "error" in row:
            # "mesh sheet-R3 free sin", or "solver SparseNewton 1e-06", or "gradient triangulax cg 1e-08".
            key = " ".join([first[len("sheet-")], *others] if what == "mesh" else [first, *others[:-1]])
            found.setdefault(key, []).append(row)
    return {key: sorted(here, key=cells_of) if what == "mesh" else here for key, here in found.items()}


def cells_of(row: Row) -> int:
    """The cells of a sheet along a side."""
    return int(row["label"].split()[1][len("sheet-") + 1 :])


def seconds_of(row: Row) -> float:
    """The time of a row: of the relaxation alone if it is about that."""
    return (row["forward"] if row["label"].startswith("solver ") and "forward" in row else row)["median_s"]


def claims(rows: list[Row]) -> list[str]:
    """What free directors cost at equal mesh, and what they win at equal error."""
    known, lines, ratios = curves(rows, "mesh"), [], []
    for kind in KINDS:
        free, average = known.get(f"{kind} free sin", []), known.get(f"{kind} average sin", [])
        ratios += [a["median_s"] / b["median_s"] for a, b in zip(free, average, strict=False)]
        if free and average:
            best, finest = min(average, key=lambda row: row["error"]), free[-1]
            reached = next((row for row in free if row["error"] <= best["error"]), None)
            if reached is not None:
                lines.append(
                    f"On {kind}, the best that averaged normals reach is an error of {best['error']:.1e}, in "
                    f"{tables.seconds(best['median_s'])} with {cells_of(best)} cells a side; free directors fall below "
                    f"it with {cells_of(reached)} cells in {tables.seconds(reached['median_s'])}, "
                    f"{best['median_s'] / reached['median_s']:.1f} times as fast."
                )
            lines.append(
                f"On {kind} with {cells_of(finest)} cells, free directors are off by {finest['error']:.1e}, averaged "
                f"normals by {average[-1]['error']:.1e}."
            )
    if ratios:
        lines.insert(
            0,
            f"Free directors take {statistics.median(ratios):.1f} times as long as averaged normals on the same mesh "
            f"({min(ratios):.1f} to {max(ratios):.1f}).",
        )
    return lines


def page(rows: list[Row]) -> str:
    absent = [f"Not measured: {row['label']}: {tables.missing(row)}." for row in rows if tables.missing(row)]
    return "\n".join(f"- {line}" for line in claims(rows) + absent)


def of_mesh(rows: list[Row]) -> str:
    """The table of all meshes."""
    names = lambda method, row: [*method.split(maxsplit=1), str(cells_of(row))]
    return _table(curves(rows, "mesh"), ("mesh", "bending, minimiser", "cells"), names)


def of_relaxation(rows: list[Row]) -> str:
    """The table of all minimisers."""
    return _table(curves(rows, "solver"), ("", "tolerance"), _by_parameter)


def of_gradient(rows: list[Row]) -> str:
    """The table of all ways to a gradient."""
    return _table(curves(rows, "gradient"), ("", "tolerance, step or number of steps"), _by_parameter)


def _by_parameter(method: str, row: Row) -> list[str]:
    return [method, f"{float(row['label'].split()[-1]):g}"]


def _table(found: dict[str, list[Row]], head: tuple[str, ...], names: Callable[[str, Row], list[str]]) -> str:
    lines = []
    for method, here in found.items():
        for row in here:
            steps = tables.steps(row) if "steps" in row else ""
            cells = [tables.small(row["error"]), tables.seconds(seconds_of(row)), steps, tables.short_commit(row)]
            lines.append([*names(method, row), *cells])
    return tables.table((*head, "error", "time", "steps", "commit"), lines)
