"""The metrics that the two layers of a sheet must take for it to have a given shape: the bilayer turned round."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._geometry.forms import CurvatureForm, components, determinant, first_form, second_form
from .._mesh.mesh import Mesh


class LayerMetrics(eqx.Module):
    """The rest metric, and what each layer must have instead; and how strongly each face is bent for it."""

    rest: Float[Array, "F 2 2"]
    top: Float[Array, "F 2 2"]
    bottom: Float[Array, "F 2 2"]
    bend: Float[Array, " F"]
    """Thickness times the largest change of curvature. The layers' metrics are positive definite below 3/2."""


def layer_metrics(
    mesh: Mesh, target: Float[Array, "V 3"], thickness: float | Array, form: CurvatureForm
) -> LayerMetrics:
    """g ± (2 h / 3) (b - b0) for a target with the forms g and b."""
    target = jnp.asarray(target, dtype=float)
    if target.shape != mesh.vertices.shape:
        raise ValueError(
            f"The target has shape {target.shape}, but the mesh has {mesh.n_vertices} vertices: give where each of "
            f"them should go, shape ({mesh.n_vertices}, 3)."
        )
    h = jnp.broadcast_to(jnp.asarray(thickness, dtype=float), (mesh.n_faces,))
    metric = first_form(target, mesh)
    bend = h[:, None, None] * (second_form(target, mesh, form) - second_form(mesh.vertices, mesh, form))
    values, _ = eigen(metric, bend)
    difference = 2 / 3 * bend
    return LayerMetrics(
        first_form(mesh.vertices, mesh),
        metric + difference,
        metric - difference,
        jnp.max(jnp.abs(values), axis=1),
    )


def eigen(metric: Float[Array, "F 2 2"], form: Float[Array, "F 2 2"]) -> tuple[Float[Array, "F 2"], Float[Array, " F"]]:
    """Eigenvalues of a form in a metric, the larger first, and the angle of the larger one's axis from the first edge
    in that metric."""
    (r11, r12, _), (e11, e12, e22) = components(metric), components(form)
    shear, det = r12 / r11, determinant(components(metric))
    m11, m12 = e11 / r11, (e12 - shear * e11) / jnp.sqrt(det)
    m22 = (e22 - 2 * shear * e12 + shear**2 * e11) * r11 / det
    mean, radius = 0.5 * (m11 + m22), jnp.hypot(0.5 * (m11 - m22), m12)
    return jnp.stack([mean + radius, mean - radius], axis=1), 0.5 * jnp.arctan2(2 * m12, m11 - m22)


def impossible(metrics: LayerMetrics) -> np.ndarray:
    """The faces of which a layer would need a metric that is not positive definite."""
    return np.flatnonzero(np.asarray(metrics.bend) >= 1.5)
