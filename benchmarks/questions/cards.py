"""Problems with known answers: for each card the problem, a figure, and exact and computed values with their orders."""

from dataclasses import asdict

from validation.cards import CARDS, card
from validation.figures import MEASURABLE, Figure, by_series, slope

from .. import results, tables
from ..case import Case, Row
from ..conditions import ROOT


def cases(quick: bool) -> list[Case]:
    level = 1 if quick else 3
    return [
        Case(name, "questions.cards", {"name": name, "level": level}, needs_gb=2.0, limit_s=7200.0) for name in CARDS
    ]


def measure(name: str, level: int) -> dict:
    """All figures of a card."""
    return {"figures": [asdict(figure) for figure in card(name).measure(level)]}


def summary(row: Row, raw: dict[str, Row]) -> Row:
    """Each quantity on each series of meshes: errors over the cells, and the finest in full."""
    groups = by_series(Figure(**figure) for figure in row.get("figures", ())).values()
    series = [
        {
            "quantity": group[-1].quantity,
            "series": group[-1].series,
            "exact": float(f"{group[-1].exact:.12g}"),
            "ours": float(f"{group[-1].ours:.12g}"),
            "cells": [figure.cells for figure in group],
            "error": [figure.error for figure in group],
            "seconds": group[-1].seconds,
        }
        for group in groups
    ]
    short = {key: value for key, value in row.items() if key != "figures"}
    return results.compact(short) | {"series": [results.compact(one) for one in series]}


def page(rows: list[Row]) -> str:
    known = {row["label"]: row for row in rows}
    return "\n\n".join(_section(name, known.get(name)) for name in CARDS)


def _section(name: str, row: Row | None) -> str:
    text = card(name)
    parts = [f"## {text.TITLE}", text.PROBLEM]
    if row is None or tables.missing(row):
        reason = "not measured yet" if row is None else tables.missing(row)
        return "\n\n".join([*parts, f"*{reason}: `python -m benchmarks cards --only {name}`.*"])
    picture = ROOT / "docs" / "assets" / f"validation_{name}.png"
    if picture.exists():
        parts.append(f"![Errors of {text.TITLE.lower()} against the mesh size](assets/{picture.name})")
    head = ("quantity", "series", "cells", "exact", "shellkit", "error", "order", "time")
    table = tables.table(head, [_line(one) for one in row["series"]])
    return "\n\n".join([*parts, table, tables.conditions([row])])


def _line(one: Row) -> list[str]:
    cells, error, ours = one["cells"][-1], one["error"][-1], one["ours"]
    refined = len(one["cells"]) > 1 and cells > 0 and all(abs(value) > MEASURABLE for value in one["error"])
    return [
        one["quantity"],
        one["series"],
        f"{cells:.3g}" if cells else "",
        f"{one['exact']:.9g}",
        f"{ours:.9g}" if one["exact"] else f"{ours:.1e}",
        f"{error:+.1e}",
        f"{slope(one['cells'], one['error']):.2f}" if refined else "",
        tables.seconds(one["seconds"]),
    ]
