"""Training: the loop, its compiled step, methods, and what a fit records and keeps on disk."""

from .checkpoint import Checkpoint as Checkpoint
from .checkpoint import load_checkpoint as load_checkpoint
from .choices import Refuse as Refuse
from .choices import WarmStart as WarmStart
from .design import Bounds as Bounds
from .fit import fit as fit
from .history import FitResult as FitResult
from .history import FitStep as FitStep
from .history import History as History
from .many import ManyFits as ManyFits
from .many import fit_many as fit_many
from .methods.base import Accepted as Accepted
from .methods.base import Course as Course
from .methods.base import Method as Method
from .methods.base import Objective as Objective
from .methods.least_squares import Dogleg as Dogleg
from .methods.least_squares import GaussNewton as GaussNewton
from .methods.least_squares import LevenbergMarquardt as LevenbergMarquardt
from .methods.rules import NielsenDamping as NielsenDamping
from .observers import JsonLines as JsonLines
from .observers import Stop as Stop
from .observers import TensorBoard as TensorBoard
from .step import Evaluation as Evaluation
