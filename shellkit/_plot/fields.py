"""What a surface can be coloured by: fields known by name, those that a mesh carries, and arrays of the user's own."""

from collections.abc import Callable
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from .._equilibrium import Equilibrium
from .._geometry.curvature import gauss_curvature, mean_curvature
from .._geometry.forms import first_form
from .._mesh.mesh import Mesh
from .shapes import Shape


@dataclass(frozen=True)
class Field:
    """One number a vertex or a face; `length` is the power of the unit of length in the field's unit, where it is
    known."""

    name: str
    values: np.ndarray
    length: int = 0

    def heading(self, unit: str | None) -> str:
        """The name with the unit, for a colour bar."""
        unit = "mesh unit" if unit is None else unit
        return self.name + {0: "", 1: f" ({unit})", -1: f" (1/{unit})", -2: f" (1/{unit}²)"}[self.length]


def field_of(shape: Shape, name: str) -> Field | None:
    """The field of that name on a shape, or `None` if it has none."""
    if name in _ON_EQUILIBRIA:
        values = None if shape.equilibrium is None else _ON_EQUILIBRIA[name][0](shape.equilibrium)
        length = _ON_EQUILIBRIA[name][1]
    elif name in _ON_SURFACES:
        moved = jnp.asarray(shape.points)
        values, length = _ON_SURFACES[name][0](moved, shape.mesh), _ON_SURFACES[name][1]
    elif name == "error":
        values, length = shape.error(), 1
    else:
        data = {**shape.mesh.vertex_data, **shape.mesh.face_data}
        values, length = data.get(name), 0
    return None if values is None else Field(name, _one_number_each(name, values, shape.mesh), length)


def field_names(shape: Shape) -> list[str]:
    """All names that `field_of` knows on a shape."""
    names = [*_ON_SURFACES]
    if shape.equilibrium is not None:
        names += _ON_EQUILIBRIA
    if shape.target is not None:
        names.append("error")
    return [*names, *shape.mesh.vertex_data, *shape.mesh.face_data]


def field_from(values: np.ndarray, name: str | None, mesh: Mesh) -> Field:
    """A field of the user's own."""
    return Field(name or "", _one_number_each(name or "color", values, mesh))


def _one_number_each(name: str, values, mesh: Mesh) -> np.ndarray:
    values = np.asarray(values)
    if values.shape not in ((mesh.n_vertices,), (mesh.n_faces,)) or values.dtype.kind not in "bifu":
        raise ValueError(
            f"plot: {name} has shape {values.shape} and type {values.dtype}; give one number a vertex, shape "
            f"({mesh.n_vertices},), or one a face, shape ({mesh.n_faces},)."
        )
    return values.astype(float)


def _stretches(metric, rest) -> np.ndarray:
    """The principal stretches of each face, ascending: roots of the eigenvalues of one metric against another."""
    lower = np.linalg.inv(np.linalg.cholesky(np.asarray(rest)))
    return np.sqrt(np.linalg.eigvalsh(lower @ np.asarray(metric) @ lower.transpose(0, 2, 1)))


def _displacement(equilibrium: Equilibrium) -> np.ndarray:
    return np.linalg.norm(equilibrium.vertices - equilibrium.mesh.vertices, axis=1)


def _elastic_strain(equilibrium: Equilibrium) -> np.ndarray:
    metric = first_form(equilibrium.vertices, equilibrium.mesh)
    return np.abs(_stretches(metric, equilibrium.rest.metric) - 1).max(axis=1)


def _stretch(equilibrium: Equilibrium) -> np.ndarray:
    mesh = equilibrium.mesh
    return _stretches(first_form(equilibrium.vertices, mesh), first_form(mesh.vertices, mesh))[:, 1]


def _actuation(equilibrium: Equilibrium) -> np.ndarray:
    return _stretches(equilibrium.rest.metric, first_form(equilibrium.mesh.vertices, equilibrium.mesh))[:, 1]


_ON_EQUILIBRIA: dict[str, tuple[Callable, int]] = {
    "displacement": (_displacement, 1),
    "strain": (_elastic_strain, 0),
    "stretch": (_stretch, 0),
    "actuation": (_actuation, 0),
    "thickness": (lambda equilibrium: equilibrium.rest.thickness, 1),
}
_ON_SURFACES: dict[str, tuple[Callable, int]] = {
    "mean curvature": (mean_curvature, -1),
    "gauss curvature": (gauss_curvature, -2),
}
