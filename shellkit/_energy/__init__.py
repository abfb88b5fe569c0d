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
from .constraints import AreaConstraint as AreaConstraint
from .constraints import Constraint as Constraint
from .constraints import Inflation as Inflation
from .constraints import VolumeConstraint as VolumeConstraint
from .contact import PlaneContact as PlaneContact
from .contact import SphereContact as SphereContact
from .discrete import DiscreteEnergy as DiscreteEnergy
from .followers import EdgeMoment as EdgeMoment
from .followers import Pressure as Pressure
from .followers import refuse_held_moments as refuse_held_moments
from .foundation import Foundation as Foundation
from .incompressible import IncompressibleNeoHookean as IncompressibleNeoHookean
from .laminate import LaminateEnergy as LaminateEnergy
from .laminate import Ply as Ply
from .loads import DeadLoad as DeadLoad
from .loads import EdgeLoad as EdgeLoad
from .loads import Gravity as Gravity
from .loads import PointLoad as PointLoad
from .loads import SurfaceLoad as SurfaceLoad
from .orthotropic import OrthotropicBending as OrthotropicBending
from .orthotropic import OrthotropicStretching as OrthotropicStretching
from .stretching import NeoHookean as NeoHookean
from .stretching import StVenantKirchhoff as StVenantKirchhoff
from .tension import TensionField as TensionField
