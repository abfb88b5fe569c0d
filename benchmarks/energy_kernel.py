"""Energy kernels: microseconds a face for energy, gradient and exact assembled Hessian, on one core."""

from . import report
from .case import Case, Row


_ENERGIES = {
    "average": "St Venant–Kirchhoff, bending with averaged normals",
    "tan": 'neo-Hookean, bending with `form="tan"`',
    "free": 'St Venant–Kirchhoff, bending with `directors="free"`',
    "membrane": "St Venant–Kirchhoff alone",
}


def cases(quick: bool) -> list[Case]:
    return [
        Case(
            f"icosphere-{level} {energy}",
            "energy_kernel",
            {"subdivisions": level, "energy": energy, "runs": 20 if quick else 100 // 2 ** (level - 3)},
            threads=1,
        )
        for energy in _ENERGIES
        for level in ((3,) if quick else (3, 4, 5))
    ]


def page(rows: list[Row]) -> str:
    head = ("", "vertices", "energy", "gradient", "Hessian", "all three", "µs a face", "fastest run")
    lines = []
    for row in rows:
        title = _ENERGIES[row["case"]["energy"]]
        if reason := report.missing(row):
            lines.append([title, f"*{reason}*", *[""] * (len(head) - 2)])
            continue
        kernels = row["kernels"]
        per_face = lambda seconds, row=row: f"{1e6 * seconds / row['n_faces']:.2f}"
        lines.append(
            [
                title,
                f"{row['n_vertices']:,}",
                *(report.seconds(report.time(kernels[name])) for name in ("energy", "gradient", "hessian", "all")),
                per_face(report.time(kernels["all"])),
                per_face(min(kernels["all"]["run_s"])),
            ]
        )
    return f"{_INTRODUCTION}\n\n{report.table(head, lines)}"


_INTRODUCTION = """\
The energy of a deformed sphere, its gradient, and its exact Hessian added up in the sparse matrix, on one core;
medians, without compilation. *All three* are computed in one call; libshell's C++, hand-written, takes 14 µs a face for
them."""
