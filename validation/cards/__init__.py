"""The cards: `measure(level)` of each module yields its figures, for meshes from coarse (1) to fine (4)."""

import importlib
from types import ModuleType


# In the order of the page.
CARDS = (
    "moduli",
    "sphere",
    "rollup",
    "consistency",
    "catenoid",
    "spectrum",
    "plate",
    "elastica",
    "large",
    "locking",
    "cones",
    "gradients",
    "roof",
)


def card(name: str) -> ModuleType:
    """The module of a card."""
    return importlib.import_module(f"validation.cards.{name}")
