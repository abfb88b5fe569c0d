"""Cost of a gradient: value and gradient of the loss, over the value alone."""

import shellkit as sk

from .. import tables
from ..case import Case, Row
from ..measure import profile
from ..problems import design_problem, director_angles, gradient_in


_SCENES = {
    "icosphere-1": ("ellipsoid", 1.1, "sin"),
    "icosphere-3": ("ellipsoid", 1.1, "sin"),
    "suzanne": ("sphericity", 1.5, "tan"),
    "icosphere-4": ("ellipsoid", 1.1, "sin"),
    "icosphere-5": ("ellipsoid", 1.1, "sin"),
}


def cases(quick: bool) -> list[Case]:
    found = []
    for mesh, (loss, stretch, form) in list(_SCENES.items())[: 1 if quick else None]:
        arguments = {"mesh": mesh, "loss": loss, "stretch": stretch, "form": form, "runs": 5 if mesh[-1] == "5" else 15}
        found.append(Case(mesh, "questions.gradient_cost", arguments, needs_gb=2.0))
    return found


def _physics(problem: sk.InverseProblem):
    return problem.actuation, problem.energy, problem.thickness


def measure(mesh: str, loss: str, stretch: float, form: str, runs: int) -> dict:
    """The loss; with its gradient in the director angles; and in all arrays of actuation, energy and thickness."""
    problem = design_problem(sk.Mesh.read(mesh), loss, stretch, "random", form)
    return {
        "n_vertices": problem.mesh.n_vertices,
        "forward": profile(lambda problem: problem.evaluate()[0], problem, runs=runs)[1],
        "angles": profile(gradient_in(director_angles), problem, runs=runs)[1],
        "physics": profile(gradient_in(_physics), problem, runs=runs)[1],
    }


def page(rows: list[Row]) -> str:
    head = ("mesh", "vertices", "loss", "gradient in the angles, on top", "over the loss")
    head += ("in all of the physics, on top", "over the loss", "memory on top")

    def cells(row: Row) -> list[str]:
        forward = row["forward"]["median_s"]
        extra = [row[name]["median_s"] - forward for name in ("angles", "physics")]
        return [
            *tables.show(row, "n_vertices"),
            tables.span(row["forward"]),
            *(cell for more in extra for cell in (tables.seconds(more), f"{more / forward:.2f}")),
            tables.megabytes(max(0.0, row["angles"]["run_mb"] - row["forward"]["run_mb"])),
        ]

    return tables.of_rows(head, rows, lambda row: [row["case"]["mesh"]], cells)
