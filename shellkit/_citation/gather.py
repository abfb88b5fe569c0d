"""Gathering the papers behind a problem from all of its parts."""

from collections.abc import Iterator
from typing import Any

import equinox as eqx


def citation(problem: eqx.Module) -> str:
    """The papers that a module and the modules in it name in `papers`, as BibTeX, each once and under a line that says
    whose it is."""
    users: dict[str, list[str]] = {}
    for part in _parts(problem):
        for paper in getattr(part, "papers", ()):
            names = users.setdefault(paper, [])
            if type(part).__name__ not in names:
                names.append(type(part).__name__)
    return "\n\n".join(f"% {', '.join(names)}\n{paper}" for paper, names in users.items()) + "\n"


def _parts(tree: Any) -> Iterator[eqx.Module]:
    if isinstance(tree, eqx.Module):
        yield tree
        tree = vars(tree)
    if isinstance(tree, dict):
        tree = tuple(tree.values())
    if isinstance(tree, (tuple, list)):
        for each in tree:
            yield from _parts(each)
