"""Losses: what is wanted of an equilibrium."""

from .base import (
    LeastSquaresLoss as LeastSquaresLoss,
    Loss as Loss,
    SumOfLosses as SumOfLosses,
    WeightedLoss as WeightedLoss,
)
from .curvature import GaussCurvature as GaussCurvature, MeanCurvature as MeanCurvature
from .regularisers import DirectorSmoothness as DirectorSmoothness, FoldPenalty as FoldPenalty
from .shape import Sphericity as Sphericity
from .size import Area as Area, Volume as Volume
from .strain import StrainLimit as StrainLimit
from .vertex import LandmarkDistance as LandmarkDistance, VertexDistance as VertexDistance
