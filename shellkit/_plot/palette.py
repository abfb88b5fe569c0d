"""The colours of all pictures. They can be told apart with any common colour blindness, and in print."""

from typing import TYPE_CHECKING

import numpy as np


if TYPE_CHECKING:
    from matplotlib.colors import ListedColormap


SURFACE = "#e9e6df"
EDGES = "#6b6b6b"
TARGET = "#333333"
TEXT = "#222222"

# From the palette of Okabe and Ito (2008): vermilion for the top layer, blue for the bottom one.
LAYERS = ("#d55e00", "#0072b2")
LINES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")

SEQUENTIAL = "cividis"
UNDER_LINES = "Purples"  # light where values are small, and of neither layer's hue
DIVERGING = "PuOr_r"


def color_map(name: str, pale: float) -> "ListedColormap":
    """A colour map of matplotlib, mixed with a fraction of light grey so that lines on it can be seen."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    colors = colormaps[name](np.linspace(0, 1, 256))
    colors[:, :3] = (1 - pale) * colors[:, :3] + 0.94 * pale
    return ListedColormap(colors, name=name)
