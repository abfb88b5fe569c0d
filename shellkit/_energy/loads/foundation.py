"""An elastic foundation: springs that draw the surface to given positions."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Scalar

from ..._geometry.surface import vertex_areas
from ..._mesh.mesh import Mesh
from ..._rest import RestShape
from ..._supports.selection import Numbers, Selection, as_selection, selected
from ..base import EnergyTerm


class Foundation(EnergyTerm):
    r"""Springs from each vertex to a position: $\frac12 \sum_v k A_v |x_v - p_v|^2$, with the area $A_v$ of the vertex
    at rest.

    In one direction only, it is Winkler's foundation.
    """

    stiffness: Float[Array, ""] | Float[Array, " V"]
    positions: Float[Array, "V 3"] | None
    direction: Float[Array, " 3"] | None
    vertices: Array | Callable | None

    def __init__(
        self,
        stiffness: Numbers,
        positions: Numbers | None = None,
        direction: Numbers | None = None,
        vertices: Selection | None = None,
    ):
        """**Arguments:**

        - `stiffness`: force per displacement and area, one number or one per vertex.
        - `positions`: where the springs are fixed, shape (V, 3); by default at the vertices at rest.
        - `direction`: in which the springs act, a vector of any length; by default in all.
        - `vertices`: those that rest on it, as for [`shellkit.Pinned`][]; by default all.

        **Raises:** `ValueError`, when a problem is built, for shapes that do not fit the mesh, a stiffness that is
        negative or not finite, or a direction that is zero.
        """
        self.stiffness = jnp.asarray(stiffness, dtype=float)
        self.positions = None if positions is None else jnp.asarray(positions, dtype=float)
        self.direction = None if direction is None else jnp.asarray(direction, dtype=float)
        self.vertices = None if vertices is None else as_selection(vertices)

    def on(self, mesh: Mesh) -> "Foundation":
        if self.vertices is None:
            return self
        return eqx.tree_at(lambda s: s.vertices, self, selected("Foundation", self.vertices, mesh))

    def check(self, mesh: Mesh) -> None:
        self.on(mesh)
        if self.stiffness.shape not in ((), (mesh.n_vertices,)):
            raise ValueError(
                f"Foundation: stiffness has shape {self.stiffness.shape}; give one number or one per vertex, shape "
                f"({mesh.n_vertices},)."
            )
        bad = np.flatnonzero(~(np.atleast_1d(self.stiffness) >= 0) | ~np.isfinite(np.atleast_1d(self.stiffness)))
        if len(bad):
            where = f" of vertex {bad[0]}" if self.stiffness.ndim else ""
            raise ValueError(f"Foundation: the stiffness{where} is negative or not finite.")
        if self.positions is not None and self.positions.shape != (mesh.n_vertices, 3):
            raise ValueError(
                f"Foundation: positions has shape {self.positions.shape}; expected one per vertex, shape "
                f"({mesh.n_vertices}, 3)."
            )
        if self.direction is not None and (self.direction.shape != (3,) or not np.any(self.direction)):
            raise ValueError(f"Foundation: direction is {self.direction}; give a vector, shape (3,), that is not zero.")

    def stencil(self, mesh: Mesh) -> Int[Array, "n 1"]:
        return self._indices(mesh)[:, None]

    def element_data(self, mesh: Mesh, rest: RestShape):
        on = self._indices(mesh)
        stiffness = (self.stiffness * vertex_areas(mesh.vertices, mesh))[on]
        positions = mesh.vertices if self.positions is None else self.positions
        if self.direction is None:
            return stiffness, positions[on], None
        direction = self.direction / jnp.linalg.norm(self.direction)
        return stiffness, positions[on], jnp.broadcast_to(direction, (len(on), 3))

    def element_energy(self, x: Float[Array, "1 3"], data) -> Scalar:
        stiffness, position, direction = data
        gap = x[0] - position
        if direction is not None:
            gap = gap @ direction
        return 0.5 * stiffness * jnp.sum(gap * gap)

    def _indices(self, mesh: Mesh) -> Int[Array, " n"]:
        if self.vertices is None:
            return jnp.arange(mesh.n_vertices)
        return selected("Foundation", self.vertices, mesh)
