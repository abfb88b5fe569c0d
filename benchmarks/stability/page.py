"""The hard cases on the page: how many were tried, how many converged, and why the others did not."""

import json
from collections import Counter
from dataclasses import asdict

from .. import report
from ..machine import describe
from .verdict import Verdict


_PATH = report.RESULTS / "stability.json"


def store(verdicts: list[tuple[str, str, Verdict]]) -> None:
    """Write what came of all cases."""
    rows = [{"material": material, "kind": kind, **asdict(verdict)} for material, kind, verdict in verdicts]
    report.RESULTS.mkdir(exist_ok=True)
    _PATH.write_text(json.dumps({"machine": describe(), "rows": rows}, indent=1, ensure_ascii=False) + "\n")


def content() -> str:
    """The table: a line for each kind of case and each energy."""
    if not _PATH.exists():
        return "*Not measured yet: `python -m benchmarks.stability`.*"
    rows = json.loads(_PATH.read_text())["rows"]
    head = ("cases", "energy", "tried", "converged", "steps", "untrue", "why the others did not")
    groups: dict[tuple[str, str], list[dict]] = {}
    for row in rows:
        groups.setdefault((row["kind"], row["material"]), []).append(row)
    lines = []
    for (kind, material), group in sorted(groups.items()):
        steps = sorted(row["steps"] for row in group if row["converged"])
        reasons = Counter(row["reason"] for row in group if not row["converged"])
        lines.append(
            [
                kind,
                material,
                str(len(group)),
                str(len(steps)),
                f"{steps[0]}–{steps[-1]}, median {steps[len(steps) // 2]}" if steps else "",
                str(sum(not (row["honest"] and row["finite"]) for row in group)),
                "; ".join(f"{count} × {reason}" for reason, count in reasons.most_common()),
            ]
        )
    return report.table(head, lines)
