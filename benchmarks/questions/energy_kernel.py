"""Energy kernels: microseconds per face for energy, gradient and exact assembled Hessian, on one core."""

import jax
import numpy as np

import shellkit as sk
from shellkit._energy import DiscreteEnergy

from .. import tables
from ..case import Case, Row
from ..measure import repeat


_TITLES = {
    "average": "St Venant–Kirchhoff, bending with averaged normals",
    "tan": 'neo-Hookean, bending with `form="tan"`',
    "free": 'St Venant–Kirchhoff, bending with `directors="free"`',
    "membrane": "St Venant–Kirchhoff alone",
}
_ENERGIES = {
    "average": lambda: sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0),
    "tan": lambda: sk.NeoHookean(bulk=1.0, shear=1.0) + sk.Bending(1.0, 1.0, form="tan"),
    "free": lambda: sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0, directors="free"),
    "membrane": lambda: sk.StVenantKirchhoff(1.0, 1.0),
}


def cases(quick: bool) -> list[Case]:
    return [
        Case(
            f"icosphere-{level} {energy}",
            "questions.energy_kernel",
            {"subdivisions": level, "energy": energy, "runs": 20 if quick else 100 // 2 ** (level - 3)},
            threads=1,
        )
        for energy in _TITLES
        for level in ((3,) if quick else (3, 4, 5))
    ]


def _energy(energy: DiscreteEnergy, y: jax.Array):
    return energy(y)


def _gradient(energy: DiscreteEnergy, y: jax.Array):
    return energy.gradient(y)


def _hessian(energy: DiscreteEnergy, y: jax.Array):
    return energy.hessian(y).values


def _all(energy: DiscreteEnergy, y: jax.Array):
    return _energy(energy, y), _gradient(energy, y), _hessian(energy, y)


def measure(subdivisions: int, energy: str, runs: int) -> dict:
    """The kernels at a deformed sphere, each compiled on its own; `all` is the three in one call."""
    mesh = sk.meshes.icosphere(subdivisions)
    problem = sk.InverseProblem(mesh=mesh, thickness=0.1, energy=_ENERGIES[energy]())
    discrete = problem.discrete_energy()
    rest = problem.assembly.restrict(problem.assembly.join(mesh.vertices, None))
    y = rest + 0.01 * np.random.default_rng(0).standard_normal(rest.shape)
    kernels = {"energy": _energy, "gradient": _gradient, "hessian": _hessian, "all": _all}
    return {
        "n_vertices": mesh.n_vertices,
        "n_faces": mesh.n_faces,
        "kernels": {name: repeat(jax.jit(kernel), discrete, y, runs=runs) for name, kernel in kernels.items()},
    }


def page(rows: list[Row]) -> str:
    head = ("", "vertices", "energy", "gradient", "Hessian", "all three", "µs a face", "fastest run")

    def cells(row: Row) -> list[str]:
        kernels = row["kernels"]
        whole = kernels["all"]
        return [
            f"{row['n_vertices']:,}",
            *(tables.seconds(kernels[name]["median_s"]) for name in ("energy", "gradient", "hessian", "all")),
            *(f"{1e6 * time / row['n_faces']:.2f}" for time in (whole["median_s"], whole["span_s"][0])),
        ]

    return f"{_INTRODUCTION}\n\n{tables.of_rows(head, rows, lambda row: [_TITLES[row['case']['energy']]], cells)}"


_INTRODUCTION = """\
The energy of a deformed sphere, its gradient, and its exact Hessian added up in the sparse matrix, on one core;
medians, without compilation. *All three* are computed in one call; libshell's C++, hand-written, takes 14 µs a face for
them."""
