"""The inverse problem: its parts, whether they fit each other, and what it computes of them."""

from .problem import InverseProblem as InverseProblem
from .states import Equilibria as Equilibria
from .states import States as States
