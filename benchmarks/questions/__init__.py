"""The benchmarks, a file for each question: its cases, what is measured of one in a child process, and its page.

Each module has `cases(quick)`, `page(rows)` and, unless all of its cases run elsewhere, `measure(**arguments)`; those
whose summary is more than `results.compact` have `summary(row, raw)`, which may look at the raw records of other rows.
"""

import importlib
from types import ModuleType


NAMES = (
    "whole_job",
    "design_step",
    "relaxation",
    "head_fields",
    "scaling",
    "gradient_cost",
    "energy_kernel",
    "pricing",
    "training",
    "surface_losses",
    "platforms",
    "accuracy",
    "precision",
    "cards",
    "hard_cases",
)


def module(name: str) -> ModuleType:
    """The module of a benchmark."""
    return importlib.import_module(f"benchmarks.questions.{name}")
