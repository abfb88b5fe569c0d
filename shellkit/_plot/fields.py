"""What a surface can be coloured by: fields known by name, those that a mesh carries, and arrays of the user's own."""

from collections.abc import Callable
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from .._analysis import energy_density, membrane_stress
from .._equilibrium import Equilibrium
from .._geometry.curvature import gauss_curvature, mean_curvature
from .._geometry.forms import first_form
from .._mesh.mesh import Mesh
from .._problem.problem import InverseProblem
from .._rest import RestShape
from .shapes import Shape


@dataclass(frozen=True)
class Field:
    """One number per vertex or a face; `length` and `pressure` are the powers of these units in the field's unit, where
    it is known."""

    name: str
    values: np.ndarray
    length: int = 0
    pressure: int = 0

    def heading(self, unit: str | None, stress_unit: str | None) -> str:
        """The name with the unit, for a colour bar."""
        unit = "mesh unit" if unit is None else unit
        if self.pressure:
            stress_unit = "unit of the moduli" if stress_unit is None else stress_unit
            return self.name + f" ({stress_unit}" + (f" · {unit})" if self.length else ")")
        return self.name + {0: "", 1: f" ({unit})", -1: f" (1/{unit})", -2: f" (1/{unit}²)"}[self.length]


def field_of(shape: Shape, name: str) -> Field | None:
    """The field of that name on a shape, or `None` if it has none."""
    length = pressure = 0
    if name in _ON_EQUILIBRIA:
        function, length = _ON_EQUILIBRIA[name]
        values = None if shape.equilibrium is None else function(shape.equilibrium)
    elif name in _OF_REST:
        function, length = _OF_REST[name]
        rest = _rest(shape)
        values = None if rest is None else function(rest, shape.mesh)
    elif name in _OF_MATERIAL:
        function, length, pressure = _OF_MATERIAL[name]
        known = shape.problem is not None and shape.equilibrium is not None
        values = function(shape.problem, shape.equilibrium) if known else None
    elif name in _ON_SURFACES:
        function, length = _ON_SURFACES[name]
        values = function(jnp.asarray(shape.points), shape.mesh)
    elif name == "error":
        values, length = shape.error(), 1
    else:
        values = {**shape.mesh.vertex_data, **shape.mesh.face_data}.get(name)
    return None if values is None else Field(name, _one_number_each(name, values, shape.mesh), length, pressure)


def field_names(shape: Shape) -> list[str]:
    """All names that `field_of` knows on a shape."""
    names = [*_ON_SURFACES]
    if shape.equilibrium is not None:
        names += _ON_EQUILIBRIA
        names += _OF_MATERIAL if shape.problem is not None else ()
    if _rest(shape) is not None:
        names += _OF_REST
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
            f"plot: {name} has shape {values.shape} and type {values.dtype}; give one number per vertex, shape "
            f"({mesh.n_vertices},), or one per face, shape ({mesh.n_faces},)."
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


def _actuated(rest: RestShape, mesh: Mesh) -> np.ndarray:
    return _stretches(rest.metric, first_form(mesh.vertices, mesh))[:, 1]


def _von_mises(problem: InverseProblem, equilibrium: Equilibrium) -> np.ndarray:
    stress = np.asarray(membrane_stress(problem, equilibrium))
    trace = stress[:, 0, 0] + stress[:, 1, 1]
    return np.sqrt(np.maximum(trace**2 - 3 * np.linalg.det(stress), 0.0))


def _rest(shape: Shape) -> RestShape | None:
    """The actuated rest shape, of a shape that has one."""
    if shape.equilibrium is not None:
        return shape.equilibrium.rest
    return None if shape.problem is None else shape.problem.rest_shape()


_ON_EQUILIBRIA: dict[str, tuple[Callable, int]] = {
    "displacement": (_displacement, 1),
    "strain": (_elastic_strain, 0),
    "stretch": (_stretch, 0),
}
_OF_REST: dict[str, tuple[Callable, int]] = {
    "actuation": (_actuated, 0),
    "thickness": (lambda rest, mesh: rest.thickness, 1),
}
_OF_MATERIAL: dict[str, tuple[Callable, int, int]] = {
    "stress": (_von_mises, 0, 1),
    "energy density": (energy_density, 1, 1),
}
_ON_SURFACES: dict[str, tuple[Callable, int]] = {
    "mean curvature": (mean_curvature, -1),
    "gauss curvature": (gauss_curvature, -2),
}
