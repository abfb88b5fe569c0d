"""Losses: what is wanted of an equilibrium."""

from .base import LeastSquaresLoss as LeastSquaresLoss
from .base import Loss as Loss
from .base import SumOfLosses as SumOfLosses
from .base import WeightedLoss as WeightedLoss
from .chamfer import Chamfer as Chamfer
from .curvature import GaussCurvature as GaussCurvature
from .curvature import MeanCurvature as MeanCurvature
from .regularisers import DirectorSmoothness as DirectorSmoothness
from .regularisers import FoldPenalty as FoldPenalty
from .shape import Sphericity as Sphericity
from .size import Area as Area
from .size import Volume as Volume
from .strain import StrainLimit as StrainLimit
from .surface import PointToSurface as PointToSurface
from .varifold import Varifold as Varifold
from .vertex import LandmarkDistance as LandmarkDistance
from .vertex import VertexDistance as VertexDistance
