"""Alignment: the motion that lays one point set upon another."""

from .aligners import Aligner as Aligner
from .aligners import Kabsch as Kabsch
from .aligners import Landmarks as Landmarks
from .aligners import Motion as Motion
from .aligners import NoAlignment as NoAlignment
from .aligners import Similarity as Similarity
from .icp import ICP as ICP
from .register import register as register
