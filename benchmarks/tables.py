"""Tables in Markdown, and how numbers stand in them."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from .case import Row


def table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """A Markdown table: the first column to the left, the others to the right."""
    rule = ["---"] + ["---:"] * (len(head) - 1)
    return "\n".join("| " + " | ".join(line) + " |" for line in (head, rule, *lines))


def of_rows(
    head: Sequence[str],
    rows: Iterable[Row],
    names: Callable[[Row], Sequence[str]],
    cells: Callable[[Row], Sequence[str]],
) -> str:
    """A table with a line per row: its names, then its cells, or the reason why there are none."""
    lines = []
    for row in rows:
        reason = missing(row)
        line = [*names(row), *([f"*{reason}*"] if reason else cells(row))]
        lines.append(line + [""] * (len(head) - len(line)))
    return table(head, lines)


def sections(titles: dict[str, str], rows: list[Row], key: str, content: Callable[[list[Row]], str]) -> str:
    """A section for each title whose rows there are: those with that argument of their case."""
    groups = {name: [row for row in rows if row["case"][key] == name] for name in titles}
    return "\n\n".join(f"### {titles[name]}\n\n{content(here)}" for name, here in groups.items() if here)


def show(row: Row, *keys: str) -> list[str]:
    """Figures of a row, each in the unit that its name tells; empty where the row has none."""
    return [_shown(key, row[key]) if key in row else "" for key in keys]


def _shown(key: str, value: Any) -> str:
    if key.endswith("_s"):
        return seconds(value)
    if key.endswith("_mb"):
        return megabytes(value)
    if key.endswith(("error", "force_norm")):
        return small(value)
    return f"{value:,}" if key.startswith("n_") else str(value)


def missing(row: Row) -> str | None:
    """Why a row has no figures; `None` if it has."""
    return row.get("skipped") or row.get("failed")


def span(row: Row) -> str:
    """Median time, with the fastest and the slowest of several runs."""
    if "span_s" not in row:
        return seconds(row["median_s"])
    fastest, slowest = row["span_s"]
    shown = seconds if (fastest < 1) != (slowest < 1) else _bare_seconds
    return f"{seconds(row['median_s'])} ({shown(fastest)}–{shown(slowest)})"


def seconds(value: float) -> str:
    """A time, with its unit."""
    return f"{_bare_seconds(value)} {'s' if value >= 1 else 'ms'}"


def _bare_seconds(value: float) -> str:
    return three_digits(value if value >= 1 else 1e3 * value)


def three_digits(value: float) -> str:
    """A number to three digits, or in full if it is large."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def small(value: float | None) -> str:
    """An error: one digit and the power of ten."""
    return "none" if value is None else f"{value:.0e}"


def megabytes(value: float) -> str:
    """Memory, in MB or GB."""
    return f"{value / 1024:.1f} GB" if value >= 1000 else f"{value:.0f} MB"


def steps(row: Row) -> str:
    """The steps of a relaxation, and whether they led to its end."""
    return f"{row.get('steps', '')}{'' if row.get('converged', True) else ', not converged'}"


def conditions(rows: list[Row]) -> str:
    """What rows were measured on, and at which commit."""
    loads = [row["load"] for row in rows if row.get("load") is not None]
    versions: dict[str, list[str]] = {}
    for row in rows:
        for name, version in row.get("versions", {}).items():
            known = versions.setdefault(name, [])
            known += [] if version in known else [version]
    parts = [
        "; ".join(dict.fromkeys(map(_machine, rows))),
        f"load of the machine when each row began {min(loads)}–{max(loads)}" if loads else "",
        days(rows),
        commits(rows),
        ", ".join(f"{name} {' and '.join(found)}" for name, found in versions.items()),
    ]
    return f"*{'; '.join(part for part in parts if part)}.*"


def days(rows: list[Row]) -> str:
    """The day on which rows were measured, or the first and the last one."""
    found = sorted({row["date"][:10] for row in rows})
    return " to ".join(dict.fromkeys((found[0], found[-1])))


def commits(rows: list[Row]) -> str:
    """The commits at which rows were measured; which ones where, if there are several.

    Rows from before that was noted have `"stored_in"` in place of `"commit"`: the commit that first had them.
    """
    labels: dict[str, list[str]] = {}
    for row in rows:
        labels.setdefault(commit(row), []).append(row["label"])
    if len(labels) == 1:
        return next(iter(labels))
    shown = lambda found: ", ".join(found) if len(found) < 8 else f"{len(found)} rows"
    return "; ".join(f"{name} ({shown(found)})" for name, found in labels.items())


def commit(row: Row) -> str:
    """The commit at which a row was measured, in words."""
    return f"at commit {row['commit']}" if "commit" in row else f"at commit {row['stored_in']} or shortly before"


def short_commit(row: Row) -> str:
    """The same for a cell of a table: `≤` means at that commit or shortly before."""
    return row["commit"] if "commit" in row else f"≤ {row['stored_in']}"


def _machine(row: Row) -> str:
    machine = row.get("machine")
    if machine is None:
        return "machine not recorded"
    threads = f"{row['threads']} threads of " if "threads" in row else ""
    return f"{machine['cpu']}, {threads}{machine['cores']} cores, {machine['memory_gb']} GB"
