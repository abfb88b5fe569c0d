"""The rest shape of a shell: metric, curvature and thickness of every face, before or after actuation."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._geometry.forms import (
    CurvatureForm,
    components,
    curvature_from_angles,
    determinant,
    first_form,
    half_angles,
    matrices,
    metric_from_lengths,
)
from ._geometry.patches import ClampedSide, Triangles
from ._mesh.mesh import Mesh


class RestShape(eqx.Module):
    """What a shell would like to be: the two fundamental forms and the thickness of every face.

    Both forms are in the basis u = b - a, v = c - a of the face (a, b, c), so that lengths carry the unit of the mesh.
    """

    metric: Float[Array, "F 2 2"]
    """The first form that each face would like to have, in the square of the mesh's unit."""
    curvature: Float[Array, "F 2 2"] | None
    """The second form, in the unit of the mesh, positive where it is convex; `None` where no energy term bends."""
    thickness: Float[Array, " F"]
    """Of the shell at rest, in the unit of the mesh."""
    stretching: Float[Array, " F"] | None = None
    """How many times as stiff a shell of layers that differ is against stretching as one of the same thickness that is
    all of the energy's material; `None` is once."""
    bending: Float[Array, " F"] | None = None
    """The same against bending."""

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
        continuation: ClampedSide | None = None,
    ) -> "RestShape":
        """The rest shape that a mesh has as it stands.

        **Arguments:**

        - `mesh`: the surface at rest.
        - `thickness`: of the shell, one value or one per face, in the unit of the mesh.
        - `form`: how the curvature is measured, see [`shellkit.second_form`][]; `None` for no curvature.
        - `continuation`: how the surface at rest goes on beyond edges whose normal is held.
        """
        curvature = None
        if form is not None:
            faces = Triangles(mesh.vertices, mesh)
            angles = half_angles(mesh.vertices, mesh, faces, None, continuation)
            curvature = matrices(curvature_from_angles(faces.squared_lengths, faces.twice_area, angles, form))
        return cls(first_form(mesh.vertices, mesh), curvature, jnp.broadcast_to(thickness, (mesh.n_faces,)))

    def sharing_edges(self, mesh: Mesh) -> "RestShape":
        r"""This rest shape with one rest length an edge: the metrics of both its faces, averaged along it.

        Metrics given face by face, as by one director each, disagree about the edge between two faces. What they
        disagree by is of first order in its length where they vary smoothly, and costs a membrane energy that goes with
        (edge / thickness)² and that no smooth sheet has. With the mean of the two squared lengths each face gets the
        metric

        $$g_r' = g_r + \frac{\Delta}{\left(1 + |\Delta|^4\right)^{1/4}}, \qquad |\Delta|^2 = \mathrm{tr}\,(g_r^{-1}
        \Delta)^2,$$

        where $\Delta$ leads to the mean lengths exactly. The denominator is one to fourth order; it keeps the metric
        positive definite where neighbours differ so much that their mean lengths form no triangle. Metrics that agree
        along every edge, as those of a mesh, are left as they are. Curvature and thickness are not touched.

        On a disc without its middle, azimuthal directors and $\lambda = 0.9$, the energy is 0.05 % off the exact one
        where that of metrics as given is 31 % off, with edges 2.4 times as long as the sheet is thick; 0.01 and 9 %
        with edges of half that length.

        **Arguments:**

        - `mesh`: whose faces the metrics belong to.

        ??? cite "Source"

            T. Regge, "General relativity without coordinates", Il Nuovo Cimento 19 (1961), 558: a surface of flat
            triangles has one length an edge, and needs no more to have a metric. The mean and its limit are ours.
        """
        metric = components(self.metric)
        own = jnp.stack([metric[0] - 2 * metric[1] + metric[2], metric[2], metric[0]])
        across = own.T.reshape(-1)[jnp.maximum(mesh.twins.T, 0)]
        change = metric_from_lengths(jnp.where(mesh.twins.T >= 0, 0.5 * (across - own), 0.0))
        # tr (g⁻¹ Δ)² = (tr g⁻¹ Δ)² - 2 det Δ / det g, with no square root to differentiate at zero.
        det = determinant(metric)
        trace = (metric[2] * change[0] - 2 * metric[1] * change[1] + metric[0] * change[2]) / det
        size = trace**2 - 2 * determinant(change) / det
        limit = (1 + size**2) ** -0.25
        return eqx.tree_at(lambda rest: rest.metric, self, self.metric + limit[:, None, None] * matrices(change))


def checked_rest_lengths(rest_lengths: str) -> str:
    """Which rest lengths faces have, refused if it is not one of the two ways."""
    if rest_lengths not in ("own", "shared"):
        raise ValueError(f'InverseProblem: rest_lengths is {rest_lengths!r}; expected "own" or "shared".')
    return rest_lengths
