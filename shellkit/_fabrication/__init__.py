"""From a design to things that can be made: director fields and streamlines as files for machines, and what is to be
printed as closed surfaces."""

from .directors import export_directors as export_directors
from .lines import export_streamlines as export_streamlines
from .placement import streamlines as streamlines
from .solid import thicken as thicken
