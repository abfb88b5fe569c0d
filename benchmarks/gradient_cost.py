"""Cost of a gradient: value and gradient of the loss, over the value alone."""

from . import report
from .case import Case, Row


_SCENES = {
    "icosphere-1": ("ellipsoid", 1.1, "sin"),
    "icosphere-3": ("ellipsoid", 1.1, "sin"),
    "suzanne": ("sphericity", 1.5, "tan"),
    "icosphere-4": ("ellipsoid", 1.1, "sin"),
    "icosphere-5": ("ellipsoid", 1.1, "sin"),
}


def cases(quick: bool) -> list[Case]:
    return [
        Case(
            mesh,
            "gradient_cost",
            {"mesh": mesh, "loss": loss, "stretch": stretch, "form": form, "runs": 5 if mesh == "icosphere-5" else 15},
            needs_gb=2.0,
        )
        for mesh, (loss, stretch, form) in _SCENES.items()
        if mesh == "icosphere-1" or not quick
    ]


def page(rows: list[Row]) -> str:
    head = (
        "mesh",
        "vertices",
        "loss",
        "gradient in the angles, on top",
        "over the loss",
        "in all of the physics, on top",
        "over the loss",
        "memory on top",
    )
    lines = []
    for row in rows:
        if reason := report.missing(row):
            lines.append([row["case"]["mesh"], f"*{reason}*", *[""] * (len(head) - 2)])
            continue
        forward = report.time(row["forward"])
        extra = {name: report.time(row[name]) - forward for name in ("angles", "physics")}
        lines.append(
            [
                row["case"]["mesh"],
                f"{row['n_vertices']:,}",
                report.span(row["forward"]),
                report.seconds(extra["angles"]),
                f"{extra['angles'] / forward:.2f}",
                report.seconds(extra["physics"]),
                f"{extra['physics'] / forward:.2f}",
                report.megabytes(max(0.0, row["angles"]["run_mb"] - row["forward"]["run_mb"])),
            ]
        )
    return f"{_INTRODUCTION}\n\n{report.table(head, lines)}"


_INTRODUCTION = """\
The gradient of the tutorial's losses goes through the relaxation by one solve with the Hessian at the minimum: with its
own factor up to 3000 unknowns, and beyond by conjugate gradients with the factor that the relaxation left, five to
eight sweeps, unless those are too many. Random directors; ellipsoid at λ = 1.1, and Suzanne (sphericity, neo-Hookean,
`form="tan"`) at λ = 1.5. *All of the physics* is every array of actuation, energy and thickness at once. What comes *on
top* is the time of value and gradient less that of the value, medians, without compilation."""
