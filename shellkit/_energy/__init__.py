"""Energies: what deformation costs."""

from .assembly import Assembly as Assembly
from .base import (
    AbstractEnergy as AbstractEnergy,
)
from .base import (
    EnergyTerm as EnergyTerm,
)
from .base import (
    FormEnergy as FormEnergy,
)
from .base import (
    ScaledEnergy as ScaledEnergy,
)
from .base import (
    SumOfEnergies as SumOfEnergies,
)
from .bending import Bending as Bending
from .bending import DihedralBending as DihedralBending
from .discrete import DiscreteEnergy as DiscreteEnergy
from .stretching import NeoHookean as NeoHookean
from .stretching import StVenantKirchhoff as StVenantKirchhoff
