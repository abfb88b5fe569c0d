"""Energy kernels: microseconds per face for energy, gradient and exact assembled Hessian, on one core."""

import itertools

import shellkit as sk

from .. import tables
from ..case import Case, Row
from ..problems import kernels


_ENERGIES = {
    "average": lambda: sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0),
    "tan": lambda: sk.NeoHookean(bulk=1.0, shear=1.0) + sk.Bending(1.0, 1.0, form="tan"),
    "free": lambda: sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0, directors="free"),
    "membrane": lambda: sk.StVenantKirchhoff(1.0, 1.0),
}
_TITLES = {
    "average": "St Venant–Kirchhoff, bending with averaged normals",
    "tan": 'neo-Hookean, bending with `form="tan"`',
    "free": 'St Venant–Kirchhoff, bending with `directors="free"`',
    "membrane": "St Venant–Kirchhoff alone",
}
_KERNELS = {
    "energy": lambda energy, y: energy(y),
    "gradient": lambda energy, y: energy.gradient(y),
    "hessian": lambda energy, y: energy.hessian(y).values,
    "all": lambda energy, y: (energy(y), energy.gradient(y), energy.hessian(y).values),
}


def cases(quick: bool) -> list[Case]:
    found = []
    for energy, level in itertools.product(_ENERGIES, (3,) if quick else (3, 4, 5)):
        arguments = {"subdivisions": level, "energy": energy, "runs": 20 if quick else 100 // 2 ** (level - 3)}
        found.append(Case(f"icosphere-{level} {energy}", "questions.energy_kernel", arguments, threads=1))
    return found


def measure(subdivisions: int, energy: str, runs: int) -> dict:
    """The kernels at a deformed sphere, each compiled on its own; `all` is the three in one call."""
    mesh = sk.meshes.icosphere(subdivisions)
    problem = sk.InverseProblem(mesh=mesh, thickness=0.1, energy=_ENERGIES[energy]())
    return kernels(problem, _KERNELS, runs) | {"n_vertices": mesh.n_vertices, "n_faces": mesh.n_faces}


def page(rows: list[Row]) -> str:
    head = ("", "vertices", "energy", "gradient", "Hessian", "all three", "µs a face", "fastest run")

    def cells(row: Row) -> list[str]:
        times = [row["kernels"][name]["median_s"] for name in _KERNELS]
        per_face = [f"{1e6 * time / row['n_faces']:.2f}" for time in (times[-1], row["kernels"]["all"]["span_s"][0])]
        return [*tables.show(row, "n_vertices"), *map(tables.seconds, times), *per_face]

    return tables.of_rows(head, rows, lambda row: [_TITLES[row["case"]["energy"]]], cells)
