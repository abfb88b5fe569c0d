"""Reading and writing meshes: the format is told by the extension, each format is a module of `formats`, and what a
format cannot keep is said aloud. Files appear whole or not at all."""

import importlib
import os
import tempfile
import warnings
from pathlib import Path

from .formats.content import Content, MeshDataWarning, MeshFileError, MeshFileNotFoundError


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


def read(path: str | os.PathLike) -> Content:
    """Reads a file of triangles; see `Mesh.read`."""
    module = _module(path)
    if not Path(path).is_file():
        raise MeshFileNotFoundError(f"{os.fspath(path)}: there is no such file (working folder: {os.getcwd()}).")
    try:
        return module.read(Path(path))
    except Exception as error:  # readers meet whatever a file holds
        reason = str(error) or type(error).__name__
        raise MeshFileError(f"{os.fspath(path)}: not read as a .{_extension(path)} mesh: {reason}") from error


def write(path: str | os.PathLike, content: Content) -> None:
    """Writes a file of triangles by way of a temporary one beside it; see `Mesh.write`."""
    module = _module(path)
    path = Path(path)
    if not path.parent.is_dir():
        raise MeshFileNotFoundError(f"{path}: there is no folder {path.parent}; create it first.")
    with tempfile.TemporaryDirectory(prefix=".", dir=path.parent) as folder:
        part = Path(folder) / path.name
        dropped = module.write(part, content)
        os.replace(part, path)
    if dropped:
        warnings.warn(
            f"{path}: a .{_extension(path)} file cannot keep {', '.join(dropped)}; the rest is written. "
            "vtu, vtp and vtk keep all data.",
            MeshDataWarning,
            stacklevel=3,
        )


def _extension(path):
    return Path(path).suffix.lower().removeprefix(".")


def _module(path):
    name = _MODULES.get(_extension(path))
    if name is None:
        raise MeshFileError(f"{os.fspath(path)}: unknown format; the extension must be one of {', '.join(_MODULES)}.")
    return importlib.import_module(f".formats.{name}", __package__)
