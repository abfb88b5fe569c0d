"""Dead loads: forces that keep their size and direction whatever the shell does. Their energy is minus their work."""

import abc
from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Scalar

from ..._geometry.surface import corners_to_vertices, edge_lengths, face_areas
from ..._mesh.mesh import Mesh
from ..._rest import RestShape
from ..._supports.selection import Numbers, Selection, as_selection, selected, selected_edges
from ..base import AbstractEnergy, EnergyTerm


class DeadLoad(EnergyTerm):
    """Constant forces at the vertices. Subclass it and write `nodal_forces` for a load of your own.

    The energy is minus the work from the shape at rest on, $-\\sum_v f_v \\cdot (x_v - x_v^0)$; it is linear, and adds
    nothing to the Hessian. Along a path the load grows in proportion.

    ??? example

        ```python
        class Wind(sk.DeadLoad):
            pressure: Array

            def nodal_forces(self, mesh, rest):
                areas = sk.vertex_areas(mesh.vertices, mesh)
                return self.pressure * areas[:, None] * jnp.array([1.0, 0.0, 0.0])
        ```
    """

    linear: ClassVar[bool] = True

    @abc.abstractmethod
    def nodal_forces(self, mesh: Mesh, rest: RestShape) -> Float[Array, "V 3"]:
        """The force at every vertex.

        **Arguments:**

        - `mesh`: the surface at rest.
        - `rest`: its rest shape under actuation.

        **Returns:**

        An array of shape `(V, 3)`, in units of pressure times area.
        """

    def stencil(self, mesh: Mesh) -> Int[Array, "V 1"]:
        return jnp.arange(mesh.n_vertices)[:, None]

    def element_data(self, mesh: Mesh, rest: RestShape) -> tuple[Float[Array, "V 3"], Float[Array, "V 3"]]:
        return self.nodal_forces(mesh, rest), mesh.vertices

    def element_energy(self, x: Float[Array, "1 3"], data) -> Scalar:
        force, start = data
        return -jnp.sum(force * (x[0] - start))

    def at(self, progress: float | Scalar) -> AbstractEnergy:
        return progress * self


class SurfaceLoad(DeadLoad):
    """A force per area of the surface at rest, such as snow, or the weight of a sheet of known weight per area.

    It neither turns with the surface nor grows with its area; [`shellkit.Pressure`][] does both. A third of the force
    on a face acts at each of its corners.
    """

    force: Float[Array, " 3"] | Float[Array, "F 3"]

    def __init__(self, force: Numbers):
        """**Arguments:**

        - `force`: per area, in units of pressure; one vector or one per face, shape (F, 3).

        **Raises:** `ValueError`, when a problem is built, for another shape, or what is not finite.
        """
        self.force = jnp.asarray(force, dtype=float)

    def check(self, mesh: Mesh) -> None:
        _check_vectors("SurfaceLoad", "force", self.force, [(3,), (mesh.n_faces, 3)])

    def nodal_forces(self, mesh: Mesh, rest: RestShape) -> Float[Array, "V 3"]:
        return _spread_over_faces(face_areas(mesh.vertices, mesh)[:, None] * self.force, mesh)


class Gravity(DeadLoad):
    """The weight of the shell: mass density times thickness, on the area at rest, times the acceleration.

    Growth moves mass about but adds none: areas are those of the mesh, not of the actuated rest shape.
    """

    density: Float[Array, ""] | Float[Array, " F"]
    acceleration: Float[Array, " 3"]

    def __init__(self, density: Numbers, acceleration: Numbers = (0.0, 0.0, -9.81)):
        """**Arguments:**

        - `density`: mass per volume, one number or one per face.
        - `acceleration`: of free fall, a vector; by default in metres per second squared, so give it in your units.

        **Raises:** `ValueError`, when a problem is built, for another shape, or what is not finite.
        """
        self.density = jnp.asarray(density, dtype=float)
        self.acceleration = jnp.asarray(acceleration, dtype=float)

    def check(self, mesh: Mesh) -> None:
        _check_vectors("Gravity", "density", self.density, [(), (mesh.n_faces,)])
        _check_vectors("Gravity", "acceleration", self.acceleration, [(3,)])

    def nodal_forces(self, mesh: Mesh, rest: RestShape) -> Float[Array, "V 3"]:
        mass = self.density * rest.thickness * face_areas(mesh.vertices, mesh)
        return _spread_over_faces(mass[:, None] * self.acceleration, mesh)


class PointLoad(DeadLoad):
    """Forces at single vertices. Under one, the deflection of a shell is finite, but its curvature is not."""

    vertices: Array | Callable
    force: Float[Array, " 3"] | Float[Array, "n 3"]

    def __init__(self, vertices: Selection, force: Numbers):
        """**Arguments:**

        - `vertices`: one index, indices of shape (n,), a mask of shape (V,), or a function from the positions at rest
            to a mask.
        - `force`: one vector, which acts at each of the vertices, or one per vertex, shape (n, 3); in units of pressure
            times area.

        **Raises:** `ValueError`, when a problem is built, for a selection or a shape that does not fit, or what is not
        finite.
        """
        self.vertices = vertices if callable(vertices) else jnp.atleast_1d(jnp.asarray(vertices))
        self.force = jnp.asarray(force, dtype=float)

    def on(self, mesh: Mesh) -> "PointLoad":
        return eqx.tree_at(lambda s: s.vertices, self, selected("PointLoad", self.vertices, mesh))

    def check(self, mesh: Mesh) -> None:
        n = len(selected("PointLoad", self.vertices, mesh))
        _check_vectors("PointLoad", "force", self.force, [(3,), (n, 3)])

    def nodal_forces(self, mesh: Mesh, rest: RestShape) -> Float[Array, "V 3"]:
        return jnp.zeros((mesh.n_vertices, 3)).at[selected("PointLoad", self.vertices, mesh)].add(self.force)


class EdgeLoad(DeadLoad):
    """A total force, spread evenly along an edge of the sheet by its length at rest.

    It acts on the boundary edges whose two ends are selected, or, if there is none, on all edges whose two ends are.
    """

    vertices: Array | Callable
    force: Float[Array, " 3"]
    edges: Int[Array, " m"] | None

    def __init__(self, edge: Selection, force: Numbers):
        """**Arguments:**

        - `edge`: its vertices: a mask of shape (V,), indices of shape (n,), edges of shape (m, 2) as their ends, or a
            function from the positions at rest, shape (V, 3), to a mask.
        - `force`: the total force, a vector, in units of pressure times area.

        **Raises:** `ValueError`, when a problem is built, for a selection without an edge, or a force of another shape
        or not finite.
        """
        self.vertices = as_selection(edge)
        self.force = jnp.asarray(force, dtype=float)
        self.edges = None

    def on(self, mesh: Mesh) -> "EdgeLoad":
        if self.edges is not None:
            return self
        found = selected("EdgeLoad", self.vertices, mesh), loaded_edges("EdgeLoad", self.vertices, mesh)
        return eqx.tree_at(lambda s: (s.vertices, s.edges), self, found, is_leaf=lambda x: x is None)

    def check(self, mesh: Mesh) -> None:
        self.on(mesh)
        _check_vectors("EdgeLoad", "force", self.force, [(3,)])

    def nodal_forces(self, mesh: Mesh, rest: RestShape) -> Float[Array, "V 3"]:
        edges = self.edges if self.edges is not None else loaded_edges("EdgeLoad", self.vertices, mesh)
        halves = 0.5 * shares(edges, mesh)[:, None] * self.force
        zero = jnp.zeros((mesh.n_vertices, 3))
        return zero.at[mesh.edges[edges]].add(jnp.broadcast_to(halves[:, None], (len(edges), 2, 3)))


def loaded_edges(owner: str, vertices: Array | Callable, mesh: Mesh) -> Int[Array, " m"]:
    """The boundary edges of a selection, or if there is none, all its edges."""
    edges = np.asarray(selected_edges(owner, vertices, mesh))
    on_boundary = edges[np.asarray(mesh.boundary_edges)[edges]]
    if len(edges) == 0:
        raise ValueError(f"{owner}: no edge of the mesh has both its ends selected; select neighbouring vertices.")
    return jnp.asarray(on_boundary if len(on_boundary) else edges)


def shares(edges: Int[Array, " m"], mesh: Mesh) -> Float[Array, " m"]:
    """The part of the total length, at rest, that each edge has."""
    lengths = edge_lengths(mesh.vertices, mesh)[edges]
    return lengths / jnp.sum(lengths)


def _spread_over_faces(forces: Float[Array, "F 3"], mesh: Mesh) -> Float[Array, "V 3"]:
    """A third of the force on each face at each of its corners."""
    corners = jnp.broadcast_to(forces[:, None] / 3, (*mesh.faces.shape, 3))
    return jnp.stack([corners_to_vertices(corners[..., k], mesh.vertices, mesh) for k in range(3)], axis=-1)


def _check_vectors(owner: str, name: str, value: Array, shapes: list[tuple[int, ...]]) -> None:
    if value.shape not in shapes:
        expected = " or ".join(map(str, shapes))
        raise ValueError(f"{owner}: {name} has shape {value.shape}; expected {expected}.")
    if not np.isfinite(value).all():
        raise ValueError(f"{owner}: {name} is not finite.")
