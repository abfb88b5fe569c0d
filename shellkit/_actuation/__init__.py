"""Actuations: what a sheet would like to become."""

from .base import (
    Actuation as Actuation,
    PartialActuation as PartialActuation,
    Passive as Passive,
    SheetActuation as SheetActuation,
)
from .bilayer import Bilayer as Bilayer
from .growth import (
    IsotropicGrowth as IsotropicGrowth,
    OrthotropicGrowth as OrthotropicGrowth,
    Prescribed as Prescribed,
)
from .nematic import Nematic as Nematic
