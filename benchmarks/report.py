"""Results on disk: the full record as JSON, and a page of tables in Markdown for the documentation to include."""

import json
import statistics
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from .case import Row
from .machine import describe


RESULTS = Path(__file__).parent / "results"


def path_of(name: str, quick: bool, suffix: str) -> Path:
    """Where results lie; those of a quick run lie apart and are not kept in git."""
    return RESULTS / f"{name}{'.quick' if quick else ''}.{suffix}"


def load(name: str, quick: bool = False) -> list[Row]:
    """The rows stored for a benchmark, none if it was never run."""
    path = path_of(name, quick, "json")
    return json.loads(path.read_text())["rows"] if path.exists() else []


def store(name: str, quick: bool, rows: list[Row], page: Callable[[list[Row]], str]) -> None:
    """Write both files of a benchmark."""
    RESULTS.mkdir(exist_ok=True)
    record = {"benchmark": name, "machine": describe(), "rows": rows}
    path_of(name, quick, "json").write_text(json.dumps(record, indent=1, ensure_ascii=False) + "\n")
    path_of(name, quick, "md").write_text(f"{page(rows).strip()}\n\n{_conditions(rows)}\n")


def table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """A Markdown table: the first column to the left, the others to the right."""
    rule = ["---"] + ["---:"] * (len(head) - 1)
    return "\n".join("| " + " | ".join(line) + " |" for line in (head, rule, *lines))


def missing(row: Row) -> str | None:
    """Why a row has no figures; `None` if it has."""
    return row.get("skipped") or row.get("failed")


def time(row: Row) -> float:
    """The median time of a profile in seconds; of the first run if there was no other."""
    return statistics.median(row["run_s"] or [row["first_s"]])


def span(row: Row) -> str:
    """Median time, with the fastest and the slowest of several runs."""
    samples = row["run_s"] or [row["first_s"]]
    if len(samples) == 1:
        return seconds(samples[0])
    shown = seconds if (min(samples) < 1) != (max(samples) < 1) else bare_seconds
    return f"{seconds(time(row))} ({shown(min(samples))}–{shown(max(samples))})"


def seconds(value: float) -> str:
    """A time, with its unit."""
    return f"{bare_seconds(value)} s" if value >= 1 else f"{three_digits(1e3 * value)} ms"


def bare_seconds(value: float) -> str:
    """A time in the unit that `seconds` would take."""
    return three_digits(value if value >= 1 else 1e3 * value)


def three_digits(value: float) -> str:
    """A number to three digits, or in full if it is large."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def small(value: float) -> str:
    """An error: one digit and the power of ten."""
    return f"{value:.0e}"


def megabytes(value: float) -> str:
    """Memory, in MB or GB."""
    return f"{value / 1024:.1f} GB" if value >= 1000 else f"{value:.0f} MB"


def _conditions(rows: list[Row]) -> str:
    done = [row for row in rows if not missing(row)]
    machines = dict.fromkeys(_machine(row) for row in rows)
    loads = [row["load"] for row in rows]
    dates = sorted({row["date"][:10] for row in rows})
    versions: dict[str, str] = {}
    for row in done:
        versions |= row["versions"]
    return (
        f"*{'; '.join(machines)}; load of the machine when each row began {min(loads)}–{max(loads)}; "
        f"{' to '.join(dict.fromkeys((dates[0], dates[-1])))}; "
        + ", ".join(f"{name} {version}" for name, version in versions.items())
        + ".*"
    )


def _machine(row: Row) -> str:
    machine = row.get("machine") or describe()
    return f"{machine['cpu']}, {row['threads']} threads of {machine['cores']} cores, {machine['memory_gb']} GB"
