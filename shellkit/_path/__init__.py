"""More than one equilibrium: relaxation along a path, arc-length continuation, and other shapes of the same shell."""

from .arc_length import ArcLength as ArcLength
from .arc_length import Branch as Branch
from .arc_length import CriticalPoint as CriticalPoint
from .arc_length import continue_path as continue_path
from .arc_length import switch_branch as switch_branch
from .arc_length import trace as trace
from .distinct import DistinctEquilibria as DistinctEquilibria
from .distinct import distinct_equilibria as distinct_equilibria
from .ramp import Path as Path
from .ramp import Ramp as Ramp
from .ramp import follow as follow
from .ramp import relax as relax
