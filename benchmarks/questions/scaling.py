"""Scaling: time and memory of every part of a relaxation, from 642 to 163,842 vertices."""

import itertools
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

import shellkit as sk
from shellkit._energy import Assembly

from .. import tables
from ..case import Case, Row
from ..measure import Stage, profile
from ..problems import ending, relaxed, teacher


# subdivisions of the icosahedron: memory that the case needs, in GB
_SIZES = {3: 1.0, 4: 1.0, 5: 2.0, 6: 5.0, 7: 18.0}
_WHAT = ("parts", "relaxation")


def cases(quick: bool) -> list[Case]:
    found = []
    for (level, needs_gb), what in itertools.product(list(_SIZES.items())[: 2 if quick else None], _WHAT):
        arguments = {"subdivisions": level, "what": what, "runs": max(1, 12 // 2 ** (level - 3))}
        label = f"icosphere-{level} {what}"
        found.append(Case(label, "questions.scaling", arguments, needs_gb=needs_gb, limit_s=1800.0))
    return found


def measure(subdivisions: int, what: str, runs: int) -> dict:
    """The tutorial's teacher on an icosphere: its `"parts"` one by one, or the whole `"relaxation"`; in two processes,
    so that each has its own memory."""
    mesh = sk.meshes.icosphere(subdivisions)
    with Stage() as construction:
        problem = teacher(mesh)
    figures = {"n_vertices": mesh.n_vertices, "n_faces": mesh.n_faces, "problem_mb": construction.megabytes}
    if what == "relaxation":
        equilibrium, relaxation = profile(relaxed, problem, runs=runs)
        return figures | relaxation | ending(equilibrium)
    y = mesh.vertices.reshape(-1)
    with Stage() as connectivity:
        sk.Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    with Stage() as numbering:
        Assembly.of(problem.energy, mesh)
    hessian, assembly = profile(lambda problem, y: problem.discrete_energy().hessian(y), problem, y, runs=runs)
    # A small shift takes the place of what Newton does about the rigid motions.
    solver = sk.SparseNewton().linear_solver
    factor, factorisation = profile(solver.factorise, hessian.shifted(1e-6), runs=runs)
    solve = profile(solver.solve, factor, jnp.sin(jnp.arange(y.size)), runs=runs)[1]
    figures |= {
        "connectivity_s": connectivity.seconds,
        "numbering_s": numbering.seconds,
        "solver": type(solver).__name__,
    }
    return figures | {"assembly": assembly, "factorisation": factorisation, "solve": solve}


# Seconds of a row of parts, by their names.
_PARTS: dict[str, Callable[[Row], float]] = {
    "connectivity of the mesh": lambda row: row["connectivity_s"],
    "numbering and sparsity": lambda row: row["numbering_s"],
    "analysis": lambda row: row["factorisation"]["first_s"] - row["factorisation"]["median_s"],
    "Hessian": lambda row: row["assembly"]["median_s"],
    "factorisation": lambda row: row["factorisation"]["median_s"],
    "solve": lambda row: row["solve"]["median_s"],
}


def memory(row: Row) -> float:
    """What a relaxation needs at its peak, and the problem itself, in MB."""
    return row["run_mb"] + row["problem_mb"]


def times(rows: list[Row]) -> dict[str, tuple[list[int], list[float]]]:
    """For every part, and for the relaxation as a whole, the numbers of vertices and the seconds."""
    parts, wholes = _done(rows, "parts"), _done(rows, "relaxation")
    vertices = [row["n_vertices"] for row in parts]
    found = {name: (vertices, [part(row) for row in parts]) for name, part in _PARTS.items()}
    return found | {"relaxation": ([row["n_vertices"] for row in wholes], [row["median_s"] for row in wholes])}


def page(rows: list[Row]) -> str:
    wholes = _done(rows, "relaxation")
    vertices = [row["n_vertices"] for row in wholes]
    sizes = sorted({row["n_vertices"] for row in rows if not tables.missing(row)})

    def line(name: str, vertices: list[int], values: list[float], show: Callable[[float], str]) -> list[str]:
        """A value for each size there is one for, and the exponent of the best power of the size."""
        known = dict(zip(vertices, values, strict=True))
        fit = len(known) > 1 and min(values) > 0
        exponent = f"{np.polyfit(np.log(vertices), np.log(values), 1)[0]:.2f}" if fit else ""
        return [name, *(show(known[size]) if size in known else "" for size in sizes), exponent]

    lines = [line(name, *series, tables.seconds) for name, series in times(rows).items()]
    lines.append(line("memory", vertices, [memory(row) for row in wholes], tables.megabytes))
    facts = ("steps", "steps"), ("factorisations", "factorisations")
    facts += ("&#124;∇E&#124; at the end", "force_norm"), ("compilation", "compile_s")
    for name, key in facts:
        cells = {row["n_vertices"]: tables.show(row, key)[0] for row in wholes}
        lines.append([name, *(cells.get(size, "") for size in sizes), ""])
    absent = [f"- {row['label']}: {tables.missing(row)}" for row in rows if tables.missing(row)]
    head = ["", *(f"{size:,} vertices" for size in sizes), "exponent"]
    return "\n\n".join([tables.table(head, lines), "\n".join(absent)])


def _done(rows: list[Row], what: str) -> list[Row]:
    return [row for row in rows if row["case"]["what"] == what and not tables.missing(row)]
