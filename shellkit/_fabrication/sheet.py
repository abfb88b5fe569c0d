"""What is to be made: the surface at rest with the directors to imprint on it, in millimetres where a file asks for
them."""

import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .._actuation.director_layers import Directors, director_layers, layer_names
from .._fit.history import FitResult
from .._mesh.mesh import Mesh
from .._problem.problem import InverseProblem


class Sheet(NamedTuple):
    """A surface at rest, and the angles of its layers by name."""

    mesh: Mesh
    layers: dict[str, np.ndarray]

    @property
    def extent(self) -> float:
        """The longest side of the box around it."""
        return float(np.ptp(np.asarray(self.mesh.vertices), axis=0).max())

    @property
    def is_flat(self) -> bool:
        """Whether it lies in a plane of constant z."""
        return float(np.ptp(np.asarray(self.mesh.vertices)[:, 2])) <= 1e-9 * self.extent


def sheet_of(owner: str, thing: Mesh | InverseProblem | FitResult, directors: Directors) -> Sheet:
    """The sheet of a design, with at least one layer of directors."""
    problem = thing.problem if isinstance(thing, FitResult) else thing
    if isinstance(problem, InverseProblem):
        mesh, actuation = problem.mesh, problem.actuation
    elif isinstance(problem, Mesh):
        mesh, actuation = problem, None
    else:
        raise ValueError(
            f"{owner}: a {type(problem).__name__} is no design; give an InverseProblem, a FitResult of one, or a Mesh "
            "with directors=angles. What is imprinted is the surface at rest, not an equilibrium."
        )
    layers = director_layers(owner, mesh, actuation, directors)
    if not layers:
        raise ValueError(f"{owner}: there are no directors; give directors=angles, or an actuation that has them.")
    return Sheet(mesh, dict(zip(layer_names(len(layers)), layers, strict=True)))


def checked_path(owner: str, path: str | os.PathLike, known: tuple[str, ...]) -> Path:
    """The path, if its type is known and its folder is there."""
    path = Path(path)
    if path.suffix.lower() not in known:
        raise ValueError(f"{owner}: cannot write {path}: the type {path.suffix!r} is none of {', '.join(known)}.")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"{owner}: cannot write {path}: there is no folder {path.parent}.")
    return path


def require_flat(owner: str, sheet: Sheet, path: Path, instead: str) -> None:
    """Refuse to draw what is not flat."""
    if not sheet.is_flat:
        raise ValueError(
            f"{owner}: {path.suffix} is for flat sheets, in a plane of constant z, and the vertices span "
            f"{float(np.ptp(np.asarray(sheet.mesh.vertices)[:, 2])):.3g} along z; write {instead} instead, or turn a "
            "sheet that is flat with mesh.with_vertices(...)."
        )
