"""Before training: what a target shape asks of a sheet of two layers, and designs to start from."""

from .feasibility import Feasibility as Feasibility
from .feasibility import feasibility as feasibility
from .inverse import bilayer_inverse as bilayer_inverse
from .inverse import nematic_start as nematic_start
