"""What is kept: whole problems, to be loaded again, and series of shapes for ParaView."""

from .problems import load as load
from .problems import save as save
from .series import write_series as write_series
