"""Energies: what deformation costs."""

from .assembly import Assembly as Assembly
from .base import (
    AbstractEnergy as AbstractEnergy,
    EnergyTerm as EnergyTerm,
    FormEnergy as FormEnergy,
    ScaledEnergy as ScaledEnergy,
    SumOfEnergies as SumOfEnergies,
)
from .bending import Bending as Bending, DihedralBending as DihedralBending
from .discrete import DiscreteEnergy as DiscreteEnergy
from .stretching import NeoHookean as NeoHookean, StVenantKirchhoff as StVenantKirchhoff
