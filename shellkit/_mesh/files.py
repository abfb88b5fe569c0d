"""Reading and writing meshes: the format follows from the extension, each format is a module of `formats`, and what a
format cannot keep is said aloud. Files appear whole or not at all."""

import importlib
import os
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .._programs.whole_files import replaced
from .connectivity import SurfaceError, connect
from .formats.content import Content, MeshDataWarning, MeshFileError, MeshFileNotFoundError, Polygons
from .polygons import split
from .units import MILLIMETRES, millimetres
from .welding import weld


_MODULES = {
    "obj": "obj",
    "off": "off",
    "ply": "ply",
    "stl": "stl",
    "msh": "gmsh",
    "vtk": "vtk",
    "vtp": "vtk",
    "vtu": "vtk",
}


class Choices(NamedTuple):
    """What is done to a file's surface as it is read; see `Mesh.read`."""

    weld: float | int | bool | None
    split: bool
    drop_unused: bool
    orient: bool
    unit: str | None


def read(path: str | os.PathLike, choices: Choices) -> tuple[Content, list[str]]:
    """Reads a file of triangles; see `Mesh.read`. Also what was left out, in words."""
    module = _module(path)
    _check(choices)
    if not Path(path).is_file():
        raise MeshFileNotFoundError(f"{os.fspath(path)}: there is no such file (working folder: {os.getcwd()}).")
    try:
        return _as_chosen(module.read(Path(path)), choices)
    except Exception as error:  # readers meet whatever a file holds
        reason = error.of_file if isinstance(error, SurfaceError) else str(error) or type(error).__name__
        raise MeshFileError(f"{os.fspath(path)}: not read as a .{extension(path)} mesh: {reason}") from error


def _check(choices: Choices) -> None:
    if choices.unit is not None:
        millimetres("Mesh.read", choices.unit)
    tolerance = choices.weld
    if tolerance is not None and not (np.isfinite(tolerance) and tolerance >= 0):
        raise ValueError(
            f"Mesh.read: weld is {tolerance}; give a distance in the unit of the file, 0 for equal vertices only, or "
            "True for those that are far nearer to each other than to any other."
        )


def _as_chosen(polygons: Polygons, choices: Choices) -> tuple[Content, list[str]]:
    points, corners, sizes, vertex_data, face_data, connected = polygons
    remarks = []
    if not len(sizes):
        raise ValueError(
            f"it holds {len(points)} points and no faces. A cloud of points is no surface, but can be a target: "
            "sk.Chamfer(pyvista.read(path).points). For a surface, mesh it: "
            "pyvista.read(path).reconstruct_surface().save('surface.ply')."
        )
    inside = len(corners) and corners.min() >= 0 and corners.max() < len(points)
    others = int((sizes != 3).sum())
    if others and not choices.split:
        raise ValueError(
            f"{others} of {len(sizes)} faces are not triangles. Mesh.read(path, split=True) cuts them into triangles."
        )
    if others and not inside:
        raise ValueError(f"a face names a vertex that is not there: there are {len(points)}. Write the file anew.")
    if others:
        faces, rows = split(points, corners, sizes)
        face_data = {name: values[rows] for name, values in face_data.items()}
    else:
        faces = corners.reshape(-1, 3)
    wanted = not connected if choices.weld is None else choices.weld
    if wanted is not False and inside:
        welded = weld(points, faces, None if wanted is True else float(wanted))
        if len(welded.faces) < len(faces):
            remarks.append(f"{len(faces) - len(welded.faces)} faces without area or given twice were left out")
        points, faces = welded.points, welded.faces
        vertex_data = {name: values[welded.kept_vertices] for name, values in vertex_data.items()}
        face_data = {name: values[welded.kept_faces] for name, values in face_data.items()}
    if choices.drop_unused and inside:
        used, faces = np.unique(faces, return_inverse=True)
        points, faces = points[used], faces.reshape(-1, 3)
        vertex_data = {name: values[used] for name, values in vertex_data.items()}
    if choices.orient:
        faces = _oriented(faces, len(points))
    if choices.unit is not None:
        points = points * MILLIMETRES[choices.unit] / MILLIMETRES["m"]
    return Content(points, faces, vertex_data, face_data), remarks


def _oriented(faces: np.ndarray, n_vertices: int) -> np.ndarray:
    """The faces, those that are turned the wrong way reversed; other faults are left for others to find."""
    try:
        connect(faces, n_vertices)
    except SurfaceError as error:
        if error.reverse is not None:
            faces = faces.copy()
            faces[error.reverse] = faces[error.reverse][:, [1, 0, 2]]
    return faces


def write(path: str | os.PathLike, content: Content, *, silent: bool = False) -> None:
    """Writes a file of triangles by way of a temporary one beside it; see `Mesh.write`. If `silent`, nothing is said of
    data that the format cannot keep."""
    module = _module(path)
    path = Path(path)
    if not path.parent.is_dir():
        raise MeshFileNotFoundError(f"{path}: there is no folder {path.parent}; create it first.")
    with replaced(path) as part:
        dropped = module.write(part, content)
    if dropped and not silent:
        warnings.warn(
            f"{path}: a .{extension(path)} file cannot keep {', '.join(dropped)}; the rest is written. "
            "vtu, vtp and vtk keep all data.",
            MeshDataWarning,
            stacklevel=3,
        )


def extension(path: str | os.PathLike) -> str:
    """What tells the format of a file, in small letters, without the dot."""
    return Path(path).suffix.lower().removeprefix(".")


def _module(path):
    name = _MODULES.get(extension(path))
    if name is None:
        raise MeshFileError(f"{os.fspath(path)}: unknown format; the extension must be one of {', '.join(_MODULES)}.")
    return importlib.import_module(f".formats.{name}", __package__)
