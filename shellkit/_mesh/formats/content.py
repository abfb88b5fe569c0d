"""What passes between a mesh and its file: plain numpy arrays, and what can go wrong. Each format's module has a
`read(path) -> Content` and a `write(path, content) -> names of what was dropped`."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int


class MeshFileError(ValueError):
    """A mesh file that cannot be read or written; the message begins with its path."""


class MeshFileNotFoundError(MeshFileError, FileNotFoundError):
    """A mesh file, or the folder to write it to, that is not there."""


class MeshDataWarning(UserWarning):
    """Data of a mesh that the format of its file cannot keep."""


class Content(NamedTuple):
    """What is in a file."""

    vertices: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]
    vertex_data: dict[str, np.ndarray]
    face_data: dict[str, np.ndarray]

    def described(self) -> list[str]:
        """The names of all data, as a message about losing them says it."""
        return [f"vertex data {n!r}" for n in self.vertex_data] + [f"face data {n!r}" for n in self.face_data]


def triangles(rows: list | np.ndarray) -> Int[np.ndarray, "F 3"]:
    """Faces as an array, unless some are no triangles."""
    refuse_polygons(sum(len(row) != 3 for row in rows), len(rows))
    return np.array(rows, int).reshape(-1, 3)


def refuse_polygons(count: int, total: int) -> None:
    """Raises if `count` of `total` faces are no triangles."""
    if count:
        raise ValueError(
            f"{count} of {total} faces are not triangles. Triangulate the mesh where it comes from, or with "
            "pyvista.read(path).triangulate().save(path)."
        )
