"""Hard cases, many of each kind: nothing may return NaN, hang, or claim to have converged where it has not."""

from collections import Counter
from dataclasses import asdict

from validation.stability.cases import KINDS, MATERIALS
from validation.stability.verdict import judge

from .. import tables
from ..case import Case, Row


def cases(quick: bool) -> list[Case]:
    return [
        Case(
            f"{kind}: {material}",
            "questions.hard_cases",
            {"kind": kind, "material": material, "count": min(count, 4) if quick else count},
        )
        for kind, (_, count) in sorted(KINDS.items())
        for material in sorted(MATERIALS)
    ]


def measure(kind: str, material: str, count: int) -> dict:
    """The verdicts on all cases of a kind."""
    return {"verdicts": [asdict(judge(case)) for case in KINDS[kind][0](material, count)]}


def summary(row: Row, raw: dict[str, Row]) -> Row:
    """How many were tried, how many converged, in how many steps, and why the others did not."""
    short = {key: value for key, value in row.items() if key != "verdicts"}
    if tables.missing(row):
        return short
    verdicts = row["verdicts"]
    steps = sorted(verdict["steps"] for verdict in verdicts if verdict["converged"])
    reasons = Counter(verdict["reason"] for verdict in verdicts if not verdict["converged"])
    return short | {
        "tried": len(verdicts),
        "converged": len(steps),
        "steps": [steps[0], steps[-1], steps[len(steps) // 2]] if steps else [],
        "untrue": sum(not (verdict["honest"] and verdict["finite"]) for verdict in verdicts),
        "reasons": dict(reasons.most_common()),
    }


def page(rows: list[Row]) -> str:
    def cells(row: Row) -> list[str]:
        return [
            str(row["tried"]),
            str(row["converged"]),
            "{}–{}, median {}".format(*row["steps"]) if row["steps"] else "",
            str(row["untrue"]),
            "; ".join(f"{count} × {reason}" for reason, count in row["reasons"].items()),
        ]

    head = ("cases", "energy", "tried", "converged", "steps", "untrue", "why the others did not")
    return tables.of_rows(head, rows, lambda row: [row["case"]["kind"], row["case"]["material"]], cells)
