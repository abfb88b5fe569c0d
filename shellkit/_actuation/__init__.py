"""Actuations: what a sheet would like to become."""

from .base import Actuation as Actuation
from .base import PartialActuation as PartialActuation
from .base import Passive as Passive
from .base import SheetActuation as SheetActuation
from .bilayer import Bilayer as Bilayer
from .growth import IsotropicGrowth as IsotropicGrowth
from .growth import OrthotropicGrowth as OrthotropicGrowth
from .growth import Prescribed as Prescribed
from .growth import PrescribedMetric as PrescribedMetric
from .laminate import Laminate as Laminate
from .laminate import Layer as Layer
from .nematic import Nematic as Nematic
from .neural import NeuralDirectors as NeuralDirectors
