"""Results on disk: a summary of each benchmark, kept in git, and the raw records, which are not.

A summary has a line per case. What many cases share (machine, threads, versions) stands once, before them.
"""

import json
import math
import statistics
from pathlib import Path
from typing import Any

from .case import Row
from .conditions import ROOT


RESULTS, RAW = ROOT / "benchmarks" / "results", ROOT / "benchmarks" / "raw"
_SHARED = ("machine", "threads", "platform", "versions")
_DROPPED = {"run_s", "run_cpu_s", "first_cpu_s", "shape_probes", "exact_probes", "gradient_probes", "energy_above"}
_IN_FULL = {"energy", "exact", "ours"}  # of which differences are shown, or many digits


def path_of(name: str, quick: bool = False) -> Path:
    """Where the summary of a benchmark lies; that of a quick run is not kept in git."""
    return RAW / f"{name}.quick.json" if quick else RESULTS / f"{name}.json"


def load(name: str, quick: bool = False) -> list[Row]:
    """The rows stored for a benchmark, none if it was never run."""
    path = path_of(name, quick)
    if not path.exists():
        return []
    record = json.loads(path.read_text())
    return [record["conditions"][row.pop("conditions")] | row for row in record["rows"]]


def store(name: str, rows: list[Row], quick: bool = False) -> None:
    """Write the summary of a benchmark."""
    shared: list[Row] = []
    lines = []
    for row in rows:
        here = {key: row[key] for key in _SHARED if key in row}
        if here not in shared:
            shared.append(here)
        own = {key: value for key, value in row.items() if key not in _SHARED}
        lines.append(_line(own | {"conditions": shared.index(here)}))
    path = path_of(name, quick)
    path.parent.mkdir(exist_ok=True)
    conditions, cases = ",\n".join(map(_line, shared)), ",\n".join(lines)
    path.write_text(f'{{"benchmark": "{name}", "conditions": [\n{conditions}\n], "rows": [\n{cases}\n]}}\n')


def load_raw(name: str) -> dict[str, Row]:
    """The raw records of a benchmark that were measured on this machine, by their labels."""
    path = RAW / f"{name}.json"
    return json.loads(path.read_text()) if path.exists() else {}


def store_raw(name: str, records: dict[str, Row]) -> None:
    """Write all of the raw records of a benchmark."""
    RAW.mkdir(exist_ok=True)
    (RAW / f"{name}.json").write_text(json.dumps(records, indent=1, ensure_ascii=False) + "\n")


def compact(value: Any, key: str = "") -> Any:
    """A raw record without samples and probes, and rounded.

    A profile has the median of its samples (of the first run if there was no other), the fastest and the slowest, and
    how many there were. Points of a trace become a list for each of their numbers.
    """
    if isinstance(value, dict):
        kept = {name: compact(part, name) for name, part in value.items() if name not in _DROPPED}
        if "run_s" in value:
            samples = value["run_s"] or [value["first_s"]]
            kept |= {"median_s": _rounded(statistics.median(samples)), "samples": len(samples)}
            kept |= {"span_s": [_rounded(min(samples)), _rounded(max(samples))]} if len(samples) > 1 else {}
        return kept
    if isinstance(value, list):
        if value and isinstance(value[0], dict):
            return {name: compact([point[name] for point in value]) for name in value[0] if name not in _DROPPED}
        return [_rounded(part, 5) if isinstance(part, float) else compact(part) for part in value]
    return _rounded(value) if isinstance(value, float) and key not in _IN_FULL else value


def _rounded(value: float, digits: int = 6) -> float | None:
    return float(f"{value:.{digits}g}") if math.isfinite(value) else None


def _line(row: Row) -> str:
    return json.dumps(row, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
