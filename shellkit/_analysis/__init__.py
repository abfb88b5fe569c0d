"""What can be asked of a problem besides its solution: how it vibrates, and whether its derivatives are right."""

from .faces import energy_density as energy_density
from .faces import membrane_stress as membrane_stress
from .hausdorff import Hausdorff as Hausdorff
from .hausdorff import hausdorff as hausdorff
from .identifiability import Identifiability as Identifiability
from .identifiability import identifiability as identifiability
from .modes import Modes as Modes
from .modes import vibration_modes as vibration_modes
from .taylor import TaylorReport as TaylorReport
from .taylor import taylor_test as taylor_test
