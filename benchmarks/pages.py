"""The stored results on the pages: `python -m benchmarks.pages` writes them between the markers in the README and in
`docs/`. `--check` writes nothing and fails if that is due."""

import argparse
import re
import sys
from collections.abc import Callable
from functools import partial

from . import results, tables
from .conditions import ROOT
from .questions import module


def page_of(name: str, part: str = "page") -> str:
    """The page of a benchmark or another part of it, after its curves if they are drawn, and its conditions."""
    rows = results.load(name)
    if not rows:
        return f"*Not measured yet: `python -m benchmarks {name}`.*"
    drawn = sorted(path.name for path in (ROOT / "docs/assets").glob(f"benchmark_{name}*.svg"))
    pictures = [f"![Curves of the tables below](assets/{curves})" for curves in drawn if part == "page"]
    text = getattr(module(name), part)(rows).strip()
    # The cards and the README say where and when in their own way.
    conditions = [tables.conditions(rows)] if part == "page" and name != "cards" else []
    return "\n\n".join([*pictures, text, *conditions])


_PERFORMANCE = (
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
PAGES: dict[str, dict[str, Callable[[], str]]] = {
    "README.md": {
        "figures": partial(page_of, "design_step", "overview"),
        "waiting": partial(page_of, "whole_job", "overview"),
    },
    "docs/performance.md": {name: partial(page_of, name) for name in _PERFORMANCE},
    "docs/accuracy.md": {
        "precision": partial(page_of, "precision"),
        "accuracy": partial(page_of, "accuracy"),
        "mesh": partial(page_of, "accuracy", "of_mesh"),
        "relaxation": partial(page_of, "accuracy", "of_relaxation"),
        "gradient": partial(page_of, "accuracy", "of_gradient"),
    },
    "docs/validation.md": {"validation": partial(page_of, "cards")},
    "docs/stability.md": {"stability": partial(page_of, "hard_cases")},
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
