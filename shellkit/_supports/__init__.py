"""Supports: what of a shell is held, where it is held, and how the surface goes on beyond held edges."""

from .base import Supports as Supports
from .held import Clamped as Clamped
from .held import Pinned as Pinned
from .planes import Sliding as Sliding
from .planes import Symmetry as Symmetry
