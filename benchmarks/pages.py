"""The stored results on the pages: `python -m benchmarks.pages` writes them between the markers in the README and on
the page on performance. `--check` writes nothing and fails if that is due."""

import argparse
import re
import sys
from collections.abc import Callable

from . import report
from .case import ROOT, Row


_SCENES = {
    "icosphere-1": "ellipsoid, 42 vertices",
    "icosphere-3": "ellipsoid, 642 vertices",
    "suzanne": "Suzanne, 1400 vertices",
    "icosphere-4": "ellipsoid, 2562 vertices",
}


def design_steps() -> str:
    """The table of the README: what a design step costs from random directors, and how exact its relaxation is."""
    rows = {row["label"]: row for row in report.load("design_step")}
    if not rows:
        return _not_measured("design_step")
    head = ("scene", "shellkit", "&#124;∇E&#124;", "published", "×", "CG adjoint", "×", "&#124;∇E&#124;")
    lines = []
    for mesh, scene in _SCENES.items():
        ours, published, cg = (
            rows.get(f"{mesh} random {library}", {"skipped": "not measured"})
            for library in ("shellkit", "triangulax-published", "triangulax-cg")
        )
        if all(report.missing(row) == "not measured" for row in (ours, published, cg)):
            continue
        theirs = [cell for row in (published, cg) for cell in (_time(row), _ratio(row, ours))]
        lines.append([scene, _time(ours), _force(ours), *theirs, _force(cg)])
    done = [row for label, row in rows.items() if " random " in label and not report.missing(row)]
    loads = [row["load"] for row in done]
    machines = dict.fromkeys(row["machine"]["cpu"] for row in done)
    conditions = (
        f"*{', '.join(machines)}, {max(row['threads'] for row in done)} threads; "
        f"{max(row['date'][:10] for row in done)}; "
        f"load of the machine {min(loads)}–{max(loads)}; medians, without compilation. "
        "–: not measured. Too large: needs more memory than there was.*"
    )
    return f"{report.table(head, lines)}\n\n{conditions}"


def waiting() -> str:
    """The table of the README: how long a user waits, from starting Python."""
    from .whole_job import table

    rows = report.load("whole_job")
    if not rows:
        return _not_measured("whole_job")
    machines = dict.fromkeys(row["machine"]["cpu"] for row in rows)
    return f"{table(rows)}\n\n*{', '.join(machines)}; {max(row['date'][:10] for row in rows)}; medians of three.*"


def page_of(name: str) -> str:
    """The tables that a benchmark has written, after its curves if they are drawn."""
    path = report.path_of(name, False, "md")
    if not path.exists():
        return _not_measured(name)
    drawn = sorted(path.name for path in (ROOT / "docs/assets").glob(f"benchmark_{name}*.svg"))
    pictures = "".join(f"![Curves of the tables below](assets/{curves})\n\n" for curves in drawn)
    return pictures + path.read_text().strip()


def _time(row: Row) -> str:
    if reason := report.missing(row):
        return "–" if reason == "not measured" else "too large" if "GB" in reason else "failed"
    return report.seconds(report.time(row)) + ("" if row["converged"] else " (not converged)")


def _ratio(row: Row, ours: Row) -> str:
    if report.missing(row) or report.missing(ours):
        return ""
    return report.three_digits(report.time(row) / report.time(ours))


def _force(row: Row) -> str:
    return "" if report.missing(row) else report.small(row["force_norm"])


def _not_measured(name: str) -> str:
    return f"*Not measured yet: `python -m benchmarks {name}`.*"


def _validation() -> str:
    from .validation import page

    return page.content()


def _stability() -> str:
    from .stability import page

    return page.content()


def _precision() -> str:
    from . import precision

    return precision.content()


PAGES: dict[str, dict[str, Callable[[], str]]] = {
    "README.md": {"figures": design_steps, "waiting": waiting},
    "docs/performance.md": {
        name: (lambda name=name: page_of(name))
        for name in (
            "whole_job",
            "design_step",
            "relaxation",
            "head_fields",
            "scaling",
            "gradient_cost",
            "energy_kernel",
            "pricing",
            "platforms",
            "training",
            "surface_losses",
        )
    },
    "docs/accuracy.md": {"precision": _precision, "accuracy": lambda: page_of("accuracy")},
    "docs/validation.md": {"validation": _validation},
    "docs/stability.md": {"stability": _stability},
}


def filled(text: str, blocks: dict[str, Callable[[], str]]) -> str:
    """A page with what stands between `<!-- name:start -->` and `<!-- name:end -->` made anew."""
    for name, content in blocks.items():
        start, end = f"<!-- {name}:start -->", f"<!-- {name}:end -->"
        if not re.search(f"{start}.*?{end}", text, re.S):
            raise ValueError(f"no markers {start} and {end}")
        between = f"{start}\n{content()}\n{end}"
        text = re.sub(f"{start}.*?{end}", lambda _, between=between: between, text, flags=re.S)
    return text


def write(pages: dict[str, dict[str, Callable[[], str]]] = PAGES, check: bool = False) -> list[str]:
    """Make pages anew, or only see which are out of date; their names."""
    stale = []
    for name, blocks in pages.items():
        path = ROOT / name
        old = path.read_text()
        new = filled(old, blocks)
        if new != old:
            stale.append(name)
            if not check:
                path.write_text(new)
    return stale


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="only say whether a page is out of date")
    check = parser.parse_args().check
    stale = write(PAGES, check)
    print("\n".join(stale) or "up to date")
    sys.exit(1 if check and stale else 0)


if __name__ == "__main__":
    main()
