"""The triangle mesh: construction and checks, connectivity, generators, files and quality."""

from .formats.content import MeshDataWarning as MeshDataWarning
from .formats.content import MeshFileError as MeshFileError
from .formats.content import MeshFileNotFoundError as MeshFileNotFoundError
from .formats.content import MeshTopologyWarning as MeshTopologyWarning
from .mesh import Mesh as Mesh
from .quality import MeshQuality as MeshQuality
