"""Training: the loop, its compiled step, methods, and what a fit records and keeps on disk."""

from .checkpoint import load_checkpoint as load_checkpoint
from .design import Bounds as Bounds
from .fit import fit as fit
from .history import FitResult as FitResult
from .history import FitStep as FitStep
from .history import History as History
from .many import ManyFits as ManyFits
from .many import fit_many as fit_many
