"""Many director fields on one head: whether each relaxation from rest reaches full tolerance, and in how many steps."""

import statistics

from . import report
from .case import Case, Row


_KINDS = {
    "random": "random, one angle a face and layer",
    "training": "met along a training run from all angles at zero",
    "orthogonal": "along z on top, across it below",
}


def cases(quick: bool) -> list[Case]:
    return [
        Case(
            f"{kind} {form}",
            "head_fields",
            {"mesh": "suzanne", "kind": kind, "form": form, "count": 1 if kind == "orthogonal" else 3 if quick else 50},
            limit_s=1800.0,
        )
        for kind in _KINDS
        for form in ("tan", "sin")
    ]


def page(rows: list[Row]) -> str:
    head = ("directors", "form", "fields", "converged", "of these stable", "others", "steps", "factorisations")
    head += ("largest &#124;∇E&#124;", "a relaxation")
    lines = []
    for row in rows:
        label = [_KINDS[row["case"]["kind"]], f"`{row['case']['form']}`"]
        if reason := report.missing(row):
            lines.append([*label, f"*{reason}*", *[""] * (len(head) - 3)])
            continue
        found = row["fields"]
        done = [field for field in found if field["converged"]]
        lines.append(
            [
                *label,
                str(len(found)),
                str(len(done)),
                str(sum(field["stable"] for field in done)),
                # The first of its sentences says what happened, the others what to do.
                "; ".join(sorted({field["result"].split(":")[0] for field in found if not field["converged"]})) or "–",
                *(_median_and_most([field[name] for field in done]) for name in ("steps", "factorisations")),
                report.small(max(field["force_norm"] for field in done)) if done else "",
                report.seconds(statistics.median(field["seconds"] for field in found)),
            ]
        )
    return f"{_INTRODUCTION}\n\n{report.table(head, lines)}"


def _median_and_most(counts: list[int]) -> str:
    return f"{statistics.median(counts):g}, at most {max(counts)}" if counts else ""


_INTRODUCTION = """\
Suzanne, 1400 vertices, neo-Hookean, thickness 0.1, λ = 1.5, every relaxation from rest. The fields along the training
run are those of every second step of 100 of Adam (rate 0.15, falling), towards a sphere. Medians;
&#124;∇E&#124; is the Euclidean norm where the relaxation ended."""
