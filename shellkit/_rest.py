"""The rest shape of a shell: metric, curvature and thickness of every face, before or after actuation."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._geometry.forms import CurvatureForm, curvature_from_angles, first_form, half_angles, matrices
from ._geometry.patches import Continuation, Triangles
from ._mesh.mesh import Mesh


class RestShape(eqx.Module):
    """What a shell would like to be: the two fundamental forms and the thickness of every face.

    Both forms are in the basis u = b - a, v = c - a of the face (a, b, c), so that lengths carry the unit of the mesh.
    `curvature` is `None` where no energy term asks for it.

    A shell of layers that are not equally stiff says in `stretching` and `bending` how many times as stiff it is as
    one of the same thickness that is all of the energy's material; `None` is once.
    """

    metric: Float[Array, "F 2 2"]
    curvature: Float[Array, "F 2 2"] | None
    thickness: Float[Array, " F"]
    stretching: Float[Array, " F"] | None = None
    bending: Float[Array, " F"] | None = None

    @property
    def stretching_scale(self) -> Float[Array, " F"]:
        """What the membrane energy of each face is proportional to: thickness times `stretching`."""
        return self.thickness if self.stretching is None else self.thickness * self.stretching

    @property
    def bending_scale(self) -> Float[Array, " F"]:
        """What the bending energy of each face is proportional to: thickness cubed times `bending`."""
        return self.thickness**3 if self.bending is None else self.thickness**3 * self.bending

    @classmethod
    def of(
        cls,
        mesh: Mesh,
        thickness: Float[Array, ""] | Float[Array, " F"],
        form: CurvatureForm | None,
        continuation: Continuation | None = None,
    ) -> "RestShape":
        """The rest shape that a mesh has as it stands.

        **Arguments:**

        - `mesh`: the surface at rest.
        - `thickness`: of the shell, one value or one a face, in the unit of the mesh.
        - `form`: how the curvature is measured, see [`shellkit.second_form`][]; `None` for no curvature.
        - `continuation`: how the surface at rest goes on beyond edges whose normal is held.
        """
        curvature = None
        if form is not None:
            faces = Triangles(mesh.vertices, mesh)
            angles = half_angles(mesh.vertices, mesh, faces, None, continuation)
            curvature = matrices(curvature_from_angles(faces.squared_lengths, faces.twice_area, angles, form))
        return cls(first_form(mesh.vertices, mesh), curvature, jnp.broadcast_to(thickness, (mesh.n_faces,)))
