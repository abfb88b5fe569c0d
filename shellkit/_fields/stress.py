"""Energy and stress of each face, from the energy terms that are functions of its forms."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._energy import AbstractEnergy, Terms
from .._geometry.forms import Components, components, determinant, first_form, second_form
from .._mesh.mesh import Mesh
from .._rest import RestShape


def density_of(
    energy: AbstractEnergy,
    mesh: Mesh,
    rest: RestShape,
    vertices: Float[Array, "V 3"],
    directors: Float[Array, " E"] | None,
) -> Float[Array, " F"]:
    """See [`shellkit.energy_density`][]."""
    metric, curvature = _forms(energy, mesh, vertices, directors)
    return _energies(energy, mesh, rest, metric, curvature) / _areas(components(rest.metric))


def stress_of(
    energy: AbstractEnergy,
    mesh: Mesh,
    rest: RestShape,
    vertices: Float[Array, "V 3"],
    directors: Float[Array, " E"] | None,
) -> Float[Array, "F 2 2"]:
    """See [`shellkit.membrane_stress`][]."""
    metric, curvature = _forms(energy, mesh, vertices, directors)
    # The off-diagonal component stands twice in the metric.
    energies = lambda *g: _energies(energy, mesh, rest, g, curvature)
    value, pull_back = jax.vjp(energies, *metric)
    e11, e12, e22 = pull_back(jnp.ones_like(value))
    e12 = 0.5 * e12
    length = jnp.sqrt(metric[0])
    shift, height = metric[1] / length, jnp.sqrt(determinant(metric)) / length
    scale = 2 / (_areas(metric) * rest.thickness)
    s11 = length**2 * e11 + 2 * length * shift * e12 + shift**2 * e22
    s12 = height * (length * e12 + shift * e22)
    s22 = height**2 * e22
    rows = jnp.stack([jnp.stack([s11, s12], axis=-1), jnp.stack([s12, s22], axis=-1)], axis=-2)
    return scale[:, None, None] * rows


def _forms(
    energy: AbstractEnergy, mesh: Mesh, vertices: Array, directors: Array | None
) -> tuple[Components, Components | None]:
    """The metric of the relaxed shape, and its curvature as the energy measures it; `None` where nothing bends."""
    form = Terms.of(energy).form
    curvature = None if form is None else components(second_form(vertices, mesh, form, directors))
    return components(first_form(vertices, mesh)), curvature


def _energies(
    energy: AbstractEnergy, mesh: Mesh, rest: RestShape, metric: Components, curvature: Components | None
) -> Float[Array, " F"]:
    total = jnp.zeros(mesh.n_faces)
    for weight, term in Terms.of(energy).faces:
        data = term.element_data(mesh, rest)
        of_faces = term.density(metric, None if term.form is None else curvature, data)
        total = total + (of_faces if weight is None else weight * of_faces)
    return total


def _areas(metric: Components) -> Float[Array, " F"]:
    return 0.5 * jnp.sqrt(determinant(metric))
