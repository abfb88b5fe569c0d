"""Platforms: kernels and relaxations on the processor and on a GPU, with the linear solvers that each can use."""

import equinox as eqx
import jax

import shellkit as sk

from .. import tables
from ..case import Case, Row
from ..measure import profile
from ..problems import ending, kernels, relaxed, teacher


_SOLVERS = {"cpu": ("pardiso", "superlu"), "cuda": ("superlu", "cg")}
_NAMES = {"cpu": "processor", "cuda": "GPU"}


def cases(quick: bool) -> list[Case]:
    def case(platform: str, solver: str | None, level: int) -> Case:
        arguments = {"subdivisions": level, "solver": solver, "runs": 20 if solver is None else 3}
        label, limit_s = f"{platform} {solver or 'kernels'}-{level}", 900.0 if solver is None else 150.0
        return Case(label, "questions.platforms", arguments, platform=platform, limit_s=limit_s)

    pairs = [(platform, name) for platform, names in _SOLVERS.items() for name in names]
    levels = (3, 4) if quick else (3, 4, 5, 6)
    small = [case(platform, None, level) for platform in _SOLVERS for level in ((3,) if quick else (3, 5, 7))]
    return small + [case(*pair, level) for pair in pairs for level in levels if pair[1] != "superlu" or level < 6]


def measure(subdivisions: int, solver: str | None, runs: int) -> dict:
    """The tutorial's teacher on an icosphere: relaxed with the sparse solver of that name; its kernels if `None`."""
    mesh = sk.meshes.icosphere(subdivisions)
    problem = teacher(mesh)
    if solver is None:
        first, second = lambda energy, y: energy.value_and_gradient(y), lambda energy, y: energy.derivatives(y)[:3]
        figures = kernels(problem, {"gradient": first, "derivatives": second}, runs)
    else:
        method = sk.SparseNewton(linear_solver=sk.linear_solver(solver))
        equilibrium, record = profile(relaxed, eqx.tree_at(lambda p: p.solver, problem, method), runs=runs)
        figures = record | ending(equilibrium)
    return figures | {"device": jax.devices()[0].device_kind, "n_vertices": mesh.n_vertices, "n_faces": mesh.n_faces}


def page(rows: list[Row]) -> str:
    return "\n\n".join(
        [
            tables.of_rows(
                ("", "vertices", "energy and gradient", "with the Hessian", "µs a face"),
                [row for row in rows if row["case"]["solver"] is None],
                lambda row: [_NAMES[row["platform"]] + (f": {row['device']}" if "device" in row else "")],
                _kernels,
            ),
            tables.of_rows(
                ("", "solver", "vertices", "relaxation", "steps", "factorisations", "&#124;∇E&#124;", "compilation"),
                [row for row in rows if row["case"]["solver"] is not None],
                lambda row: [_NAMES[row["platform"]], f"`{row['case']['solver']}`"],
                _relaxation,
            ),
        ]
    )


def _kernels(row: Row) -> list[str]:
    times = [row["kernels"][name]["median_s"] for name in ("gradient", "derivatives")]
    return [*tables.show(row, "n_vertices"), *map(tables.seconds, times), f"{1e6 * times[1] / row['n_faces']:.3g}"]


def _relaxation(row: Row) -> list[str]:
    vertices, time, *others = tables.show(
        row, "n_vertices", "median_s", "steps", "factorisations", "force_norm", "compile_s"
    )
    return [vertices, time + ("" if row["converged"] else " (not converged)"), *others]
