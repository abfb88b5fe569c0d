"""The rest shape of a shell: metric, curvature and thickness of every face, before or after actuation."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._geometry.forms import CurvatureForm, first_form, second_form
from ._mesh.mesh import Mesh


class RestShape(eqx.Module):
    """What a shell would like to be: the two fundamental forms and the thickness of every face.

    Both forms are in the basis u = b - a, v = c - a of the face (a, b, c), so that lengths carry the unit of the mesh.
    `curvature` is `None` where no energy term asks for it.
    """

    metric: Float[Array, "F 2 2"]
    curvature: Float[Array, "F 2 2"] | None
    thickness: Float[Array, " F"]

    @classmethod
    def of(
        cls, mesh: Mesh, thickness: Float[Array, ""] | Float[Array, " F"], form: CurvatureForm | None
    ) -> "RestShape":
        """The rest shape that a mesh has as it stands.

        **Arguments:**

        - `mesh`: the surface at rest.
        - `thickness`: of the shell, one value or one a face, in the unit of the mesh.
        - `form`: how the curvature is measured, see [`shellkit.second_form`][]; `None` for no curvature.
        """
        curvature = None if form is None else second_form(mesh.vertices, mesh, form)
        return cls(first_form(mesh.vertices, mesh), curvature, jnp.broadcast_to(thickness, (mesh.n_faces,)))
