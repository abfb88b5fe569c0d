"""Pictures and films: surfaces with their fields and directors, and the history of a fit. pyvista and matplotlib are
imported when something is drawn, not before."""

from .films import Film as Film
from .films import Snapshots as Snapshots
from .films import animate as animate
from .histories import plot_history as plot_history
from .pictures import plot as plot
