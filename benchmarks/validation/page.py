"""The cards on the page: for each the problem, a figure, and a table of exact and computed values with their orders."""

import importlib
import json
from datetime import UTC, datetime
from pathlib import Path
from types import ModuleType

import numpy as np

from .. import report
from ..case import ROOT
from ..machine import describe
from .figures import Figure, by_series, order


# The number of each card and its module, in the order of the page.
CARDS = {
    "moduli": 1,
    "sphere": 2,
    "rollup": 3,
    "consistency": 4,
    "catenoid": 5,
    "spectrum": 6,
    "plate": 7,
    "elastica": 8,
    "large": 9,
    "locking": 10,
    "cones": 11,
    "gradients": 12,
    "roof": 13,
}
_MARKERS = {"R": "o", "X": "s", "J": "^"}  # of regular, alternating and jittered triangles
_MEASURABLE = 1e-9  # an error below this is rounding: it has no order


def module(card: str) -> ModuleType:
    """The module of a card."""
    return importlib.import_module(f"benchmarks.validation.cards.{card}")


def path_of(card: str) -> Path:
    """Where the results of a card lie."""
    return report.RESULTS / f"validation_{card}.json"


def picture_of(card: str) -> Path:
    """Where its figure lies."""
    return ROOT / "docs" / "assets" / f"validation_{card}.png"


def load(card: str) -> list[Figure]:
    """The stored figures of a card, none if it was never run."""
    path = path_of(card)
    return [Figure(**row) for row in json.loads(path.read_text())["figures"]] if path.exists() else []


def store(card: str, figures: list[Figure]) -> None:
    """Write the figures of a card."""
    report.RESULTS.mkdir(exist_ok=True)
    record = {
        "card": card,
        "machine": describe(),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "figures": [figure.row() for figure in figures],
    }
    path_of(card).write_text(json.dumps(record, indent=1, ensure_ascii=False) + "\n")


def section(card: str) -> str:
    """One card as it stands on the page."""
    text = module(card)
    parts = [f"## {text.TITLE}", text.PROBLEM]
    figures = load(card)
    if not figures:
        return "\n\n".join([*parts, f"*Not measured yet: `python -m benchmarks.validation {card}`.*"])
    if picture_of(card).exists():
        parts.append(f"![Errors of {text.TITLE.lower()} against the mesh size](assets/{picture_of(card).name})")
    head = ("quantity", "series", "cells", "exact", "shellkit", "error", "order", "time")
    parts.append(report.table(head, [_line(group) for group in by_series(figures).values()]))
    return "\n\n".join(parts)


def _line(group: list[Figure]) -> list[str]:
    finest = group[-1]
    refined = len(group) > 1 and finest.cells > 0 and all(abs(figure.error) > _MEASURABLE for figure in group)
    return [
        finest.quantity,
        finest.series,
        f"{finest.cells:.3g}" if finest.cells else "",
        f"{finest.exact:.9g}",
        f"{finest.ours:.9g}" if finest.exact else f"{finest.ours:.1e}",
        f"{finest.error:+.1e}",
        f"{order(group):.2f}" if refined else "",
        report.seconds(finest.seconds),
    ]


def content() -> str:
    """All cards, and what they were measured on."""
    dates = [json.loads(path_of(card).read_text()) for card in CARDS if path_of(card).exists()]
    measured = sorted({record["date"][:10] for record in dates})
    machines = sorted({f"{record['machine']['cpu']}, {record['machine']['cores']} cores" for record in dates})
    conditions = f"*{'; '.join(machines)}; {', '.join(measured)}.*" if dates else ""
    return "\n\n".join([section(card) for card in CARDS] + [conditions])


def draw(card: str) -> None:
    """Errors against the mesh size, a panel for each quantity that was refined."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    from ..plot import COLOURS, STYLE, legend_below

    groups = by_series(figure for figure in load(card) if abs(figure.error) > _MEASURABLE and figure.cells > 0)
    groups = {key: group for key, group in groups.items() if len(group) > 1}
    quantities = list(dict.fromkeys(quantity for quantity, _ in groups))[:4]
    if not quantities:
        return
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(1, len(quantities), figsize=(3.6 * len(quantities), 3.8), squeeze=False)
        colours: dict[str, str] = {}  # of each method, in all panels
        for axis, quantity in zip(axes[0], quantities, strict=True):
            for (name, series), group in groups.items():
                if name == quantity:
                    cells, errors = [f.cells for f in group], [abs(f.error) for f in group]
                    method, _, triangles = series.rpartition(", ")
                    method = method or ("" if triangles in _MARKERS else series)
                    colour = colours.setdefault(method, COLOURS[len(colours)])
                    look = {"marker": _MARKERS.get(triangles, "D"), "linestyle": "--" if "average" in series else "-"}
                    axis.loglog(cells, errors, color=colour, label=series, **look)
            cells = np.array([f.cells for (name, _), group in groups.items() if name == quantity for f in group])
            reference = np.array([cells.min(), cells.max()])
            top = max(abs(group[0].error) for (name, _), group in groups.items() if name == quantity)
            axis.loglog(reference, top * (reference / reference[0]) ** -2.0, "k:", lw=1, label="second order")
            ticks = sorted(set(cells.tolist()))
            axis.set_xticks(ticks, [f"{tick:.3g}" for tick in ticks])
            axis.minorticks_off()
            axis.set(xlabel="cells a side", title=quantity)
            legend_below(axis)
        axes[0, 0].set_ylabel("relative error")
        figure.savefig(picture_of(card), dpi=80, metadata={"Software": None})
        plt.close(figure)
