"""Loads that follow the surface: pressure, and moments along an edge. Their energy is minus their work."""

from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Scalar

from ..._citation.papers import SCHWEIZERHOF_1984
from ..._geometry.rowwise import unit
from ..._geometry.surface import face_normals
from ..._mesh.mesh import Mesh
from ..._rest import RestShape
from ..._supports.selection import Numbers, Selection, as_selection, selected
from ..base import AbstractEnergy, EnergyTerm
from .dead import loaded_edges, shares


class Pressure(EnergyTerm):
    r"""Pressure on the side away from the normals, so that a closed shell with outward normals is blown up: $-pV$.

    $V$ is the enclosed volume. The force is always square to the surface, $p$ times its area. An open surface is closed
    by the cone from its boundary to a fixed point, the `apex`: where the boundary is held, or slides in planes through
    the apex, the shape of that cone does not change and this is exact. Where the boundary is free, it also feels the
    pressure on the cone, as one that is clothed by a light skin does; the pressure on a free sheet alone has no energy.

    ??? cite "Source"

        K. Schweizerhof and E. Ramm, "Displacement dependent pressure loads in nonlinear finite element analyses",
        Computers and Structures 18 (1984), 1099: when such a load has a potential.
    """

    papers: ClassVar[tuple[str, ...]] = (SCHWEIZERHOF_1984,)

    pressure: Float[Array, ""]
    apex: Float[Array, " 3"] | None

    def __init__(self, pressure: Numbers, apex: Numbers | None = None):
        """**Arguments:**

        - `pressure`: of the side that the normals point away from, over that of the other; one number, in the unit of
            the moduli.
        - `apex`: of the cone that closes an open surface; by default the mean of the boundary's vertices at rest. A
            closed surface needs none.

        **Raises:** `ValueError`, when a problem is built, unless the pressure is one finite number and the apex a
        point.
        """
        self.pressure = jnp.asarray(pressure, dtype=float)
        self.apex = None if apex is None else jnp.asarray(apex, dtype=float)

    def check(self, mesh: Mesh) -> None:
        if self.pressure.shape != () or not np.isfinite(self.pressure):
            raise ValueError(
                f"Pressure: pressure is {self.pressure}; give one finite number. For a force per area that differs "
                "from place to place use a SurfaceLoad."
            )
        if self.apex is not None and (self.apex.shape != (3,) or not np.isfinite(self.apex).all()):
            raise ValueError(f"Pressure: apex is {self.apex}; give a point, shape (3,).")

    def at(self, progress: float | Scalar) -> AbstractEnergy:
        return progress * self

    def stencil(self, mesh: Mesh) -> Int[Array, "F 3"]:
        return mesh.faces

    def element_data(self, mesh: Mesh, rest: RestShape) -> tuple[Float[Array, " F"], Float[Array, "F 3"]]:
        apex = cone_apex(mesh) if self.apex is None else self.apex
        n = mesh.n_faces
        return jnp.broadcast_to(self.pressure, (n,)), jnp.broadcast_to(apex, (n, 3))

    def element_energy(self, x: Float[Array, "3 3"], data) -> Scalar:
        pressure, apex = data
        return -pressure * cone_volume(x, apex)


def cone_apex(mesh: Mesh) -> Float[Array, " 3"]:
    """The point from which volumes are counted: the mean of the vertices, of those on the boundary if there is one."""
    if mesh.is_closed:
        return jnp.mean(mesh.vertices, axis=0)
    rim = mesh.boundary_vertices[:, None]
    return jnp.sum(jnp.where(rim, mesh.vertices, 0.0), axis=0) / jnp.sum(rim).astype(float)


def cone_volume(x: Float[Array, "3 3"], apex: Float[Array, " 3"]) -> Scalar:
    """The signed volume between a triangle and an apex."""
    a, b, c = x - apex
    return a @ jnp.cross(b, c) / 6


class EdgeMoment(EnergyTerm):
    r"""A total bending moment, spread evenly along boundary edges by their length at rest; positive rolls the sheet up
    away from its normals, as a positive curvature form does.

    Its work is the moment times the angle $\psi$ by which the normal of each edge has turned about the edge's direction
    at rest, which for an edge that stays parallel to itself is the moment of a couple of any angle. The energy,
    $-M\psi$, is a function of the shape only while $\psi$ is told from $\psi + 2\pi$: angles count from `centre` - π to
    `centre` + π. Let the shell not pass these bounds: bend it from both ends, or give a `centre`.
    """

    vertices: Array | Callable
    moment: Float[Array, ""]
    centre: Float[Array, ""]
    edges: Int[Array, " m"] | None

    def __init__(self, edge: Selection, moment: Numbers, centre: Numbers = 0.0):
        """**Arguments:**

        - `edge`: its vertices: a mask of shape (V,), indices of shape (n,), edges of shape (m, 2) as their ends, or a
            function from the positions at rest, shape (V, 3), to a mask.
        - `moment`: the total moment, force times length.
        - `centre`: of the range of angles that are told apart, in radians.

        **Raises:** `ValueError`, when a problem is built, for an edge that is not on the boundary, or whose normal a
        support holds, or numbers that are not finite.
        """
        self.vertices = as_selection(edge)
        self.moment = jnp.asarray(moment, dtype=float)
        self.centre = jnp.asarray(centre, dtype=float)
        self.edges = None

    def on(self, mesh: Mesh) -> "EdgeMoment":
        if self.edges is not None:
            return self
        found = selected("EdgeMoment", self.vertices, mesh), loaded_edges("EdgeMoment", self.vertices, mesh)
        return eqx.tree_at(lambda s: (s.vertices, s.edges), self, found, is_leaf=lambda x: x is None)

    def check(self, mesh: Mesh) -> None:
        for name in ("moment", "centre"):
            value = getattr(self, name)
            if value.shape != () or not np.isfinite(value):
                raise ValueError(f"EdgeMoment: {name} is {value}; give one finite number.")
        edges = self._loaded(mesh)
        inside = np.flatnonzero(~np.asarray(mesh.boundary_edges)[np.asarray(edges)])
        if len(inside):
            ends = np.asarray(mesh.edges)[np.asarray(edges)[inside[0]]].tolist()
            raise ValueError(f"EdgeMoment: the edge between the vertices {ends} is not on the boundary of the sheet.")

    def at(self, progress: float | Scalar) -> AbstractEnergy:
        return progress * self

    def stencil(self, mesh: Mesh) -> Int[Array, "m 3"]:
        edges = self._loaded(mesh)
        opposite = mesh.faces[mesh.edge_faces[edges, 0], mesh.edge_corners[edges, 0]]
        return jnp.column_stack([mesh.edges[edges], opposite])

    def element_data(self, mesh: Mesh, rest: RestShape):
        edges = self._loaded(mesh)
        along = mesh.vertices[mesh.edges[edges, 1]] - mesh.vertices[mesh.edges[edges, 0]]
        normals = face_normals(mesh.vertices, mesh)[mesh.edge_faces[edges, 0]]
        centre = jnp.broadcast_to(self.centre, edges.shape)
        return self.moment * shares(edges, mesh), normals, jnp.cross(unit(along), normals), centre

    def element_energy(self, x: Float[Array, "3 3"], data) -> Scalar:
        moment, normal, outward, centre = data
        now = jnp.cross(x[1] - x[0], x[2] - x[0])
        cosine, sine = now @ normal, now @ outward
        from_centre = jnp.arctan2(
            sine * jnp.cos(centre) - cosine * jnp.sin(centre), cosine * jnp.cos(centre) + sine * jnp.sin(centre)
        )
        return -moment * (centre + from_centre)

    def director_moments(self, mesh: Mesh) -> Float[Array, " E"]:
        edges = self._loaded(mesh)
        return jnp.zeros(mesh.n_edges).at[edges].set(self.moment * shares(edges, mesh))

    def _loaded(self, mesh: Mesh) -> Int[Array, " m"]:
        return loaded_edges("EdgeMoment", self.vertices, mesh) if self.edges is None else self.edges
