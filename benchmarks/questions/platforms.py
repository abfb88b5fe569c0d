"""Platforms: kernels and relaxations on the processor and on a GPU, with the linear solvers that each can use."""

import equinox as eqx
import jax
import numpy as np

import shellkit as sk

from .. import tables
from ..case import Case, Row
from ..measure import profile, repeat
from ..problems import ending, relaxed, teacher


_SOLVERS = {"cpu": ("pardiso", "superlu"), "cuda": ("superlu", "cg")}
_NAMES = {"cpu": "processor", "cuda": "GPU"}


def cases(quick: bool) -> list[Case]:
    levels = (3, 4) if quick else (3, 4, 5, 6)
    kernels = [
        Case(
            f"{platform} kernels-{level}",
            "questions.platforms",
            {"subdivisions": level, "solver": None, "runs": 20},
            platform=platform,
        )
        for platform in _SOLVERS
        for level in ((3,) if quick else (3, 5, 7))
    ]
    relaxations = [
        Case(
            f"{platform} {solver}-{level}",
            "questions.platforms",
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


def measure(subdivisions: int, solver: str | None, runs: int) -> dict:
    """The tutorial's teacher on an icosphere: relaxed with the sparse solver of that name; its kernels if `None`."""
    mesh = sk.meshes.icosphere(subdivisions)
    problem = teacher(mesh)
    figures = _kernels(problem, runs) if solver is None else _relaxation(problem, solver, runs)
    return figures | {"device": jax.devices()[0].device_kind, "n_vertices": mesh.n_vertices, "n_faces": mesh.n_faces}


def _kernels(problem: sk.InverseProblem, runs: int) -> dict:
    energy = problem.discrete_energy()
    rest = problem.assembly.restrict(problem.assembly.join(problem.mesh.vertices, None))
    y = rest + 0.01 * np.random.default_rng(0).standard_normal(rest.shape)
    kernels = {
        "gradient": jax.jit(lambda energy, y: energy.value_and_gradient(y)),
        "derivatives": jax.jit(lambda energy, y: energy.derivatives(y)[:3]),
    }
    return {"kernels": {name: repeat(kernel, energy, y, runs=runs) for name, kernel in kernels.items()}}


def _relaxation(problem: sk.InverseProblem, solver: str, runs: int) -> dict:
    method = sk.SparseNewton(linear_solver=sk.direct_solver(solver))
    problem = eqx.tree_at(lambda problem: problem.solver, problem, method)
    equilibrium, record = profile(relaxed, problem, runs=runs)
    return record | ending(equilibrium)


def page(rows: list[Row]) -> str:
    kernels = [row for row in rows if row["case"]["solver"] is None]
    relaxations = [row for row in rows if row["case"]["solver"] is not None]
    return "\n\n".join([_INTRODUCTION, _kernel_table(kernels), _RELAXATIONS, _relaxation_table(relaxations)])


def _kernel_table(rows: list[Row]) -> str:
    def cells(row: Row) -> list[str]:
        first, second = (row["kernels"][name]["median_s"] for name in ("gradient", "derivatives"))
        per_face = f"{1e6 * second / row['n_faces']:.3g}"
        return [f"{row['n_vertices']:,}", tables.seconds(first), tables.seconds(second), per_face]

    def names(row: Row) -> list[str]:
        return [_NAMES[row["platform"]] + (f": {row['device']}" if "device" in row else "")]

    return tables.of_rows(("", "vertices", "energy and gradient", "with the Hessian", "µs a face"), rows, names, cells)


def _relaxation_table(rows: list[Row]) -> str:
    def cells(row: Row) -> list[str]:
        return [
            f"{row['n_vertices']:,}",
            tables.seconds(row["median_s"]) + ("" if row["converged"] else " (not converged)"),
            str(row["steps"]),
            str(row["factorisations"]),
            tables.small(row["force_norm"]),
            tables.seconds(row["compile_s"]),
        ]

    head = ("", "solver", "vertices", "relaxation", "steps", "factorisations", "&#124;∇E&#124;", "compilation")
    return tables.of_rows(head, rows, lambda row: [_NAMES[row["platform"]], f"`{row['case']['solver']}`"], cells)


_INTRODUCTION = """\
The energy of a deformed sphere with its gradient, and with both its exact sparse Hessian, on the processor and on a
GPU; medians, without compilation."""

_RELAXATIONS = """\
The tutorial's teacher, relaxed from rest. On a GPU `superlu` hands each matrix to the host and factorises it there;
`cg` stays on the device, with the inverse diagonal blocks as preconditioner."""
