"""What passes between a mesh and its file: plain numpy arrays, and what can go wrong. Each format's module has a
`read(path) -> Polygons` and a `write(path, content) -> names of what was dropped`."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int


class MeshFileError(ValueError):
    """A mesh file that cannot be read or written; the message begins with its path."""


class MeshFileNotFoundError(MeshFileError, FileNotFoundError):
    """A mesh file, or the folder to write it to, that is not there."""


class MeshDataWarning(UserWarning):
    """Data of a mesh that the format of its file cannot keep."""


class MeshTopologyWarning(UserWarning):
    """A mesh was read that may not be the surface that was meant: it is in several pieces, has several boundary loops,
    vertices that lie where others do, or faces that were dropped."""


class Content(NamedTuple):
    """What is in a file of triangles."""

    vertices: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]
    vertex_data: dict[str, np.ndarray]
    face_data: dict[str, np.ndarray]

    def described(self) -> list[str]:
        """The names of all data, as a message about losing them says it."""
        return [f"vertex data {n!r}" for n in self.vertex_data] + [f"face data {n!r}" for n in self.face_data]


class Polygons(NamedTuple):
    """What a file holds before it is looked at: faces of any number of corners, one after the other."""

    vertices: Float[np.ndarray, "V 3"]
    corners: Int[np.ndarray, " n"]
    sizes: Int[np.ndarray, " F"]
    vertex_data: dict[str, np.ndarray]
    face_data: dict[str, np.ndarray]
    connected: bool = True
    """Whether faces share vertices by their index; else each has corners of its own."""


def listed_faces(rows: Sequence | np.ndarray) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " F"]]:
    """The corners of all faces one after the other, and how many each has."""
    if isinstance(rows, np.ndarray) and rows.ndim == 2:
        return rows.ravel().astype(int), np.full(len(rows), rows.shape[1])
    sizes = np.array([len(row) for row in rows], int)
    return np.concatenate([np.zeros(0, int), *(np.asarray(row, int) for row in rows)]), sizes


def strip_triangles(strip: Int[np.ndarray, " n"]) -> Int[np.ndarray, "m 3"]:
    """The triangles of a strip: each vertex from the third on makes one with the two before it, every other one the
    other way round."""
    triangles = np.stack([strip[:-2], strip[1:-1], strip[2:]], axis=1)
    triangles[1::2] = triangles[1::2][:, [1, 0, 2]]
    a, b, c = triangles.T
    return triangles[(a != b) & (b != c) & (c != a)]  # the others only lead on
