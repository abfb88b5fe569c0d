"""Vertices that are held in place, or moved to where they are wanted; with or without the surface's normal."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from .._geometry.rowwise import unit
from .._geometry.surface import face_normals
from .._mesh.mesh import Mesh
from .._programs.tracing import known
from .base import SingleSupport
from .selection import Numbers, Selection, as_selection, selected, selected_edges


class Pinned(SingleSupport):
    """Vertices held in place, or moved; the surface may turn about them as about a hinge.

    ??? example

        ```python
        sk.Pinned(mesh.boundary_vertices)
        sk.Pinned(lambda x: jnp.isclose(x[:, 0], 0.0))
        sk.Pinned(jnp.isclose(mesh.vertices[:, 0], 10.0), displacement=jnp.array([-1.0, 0.0, 0.0]))
        ```
    """

    vertices: Array | Callable
    positions: Float[Array, "n 3"] | None
    displacement: Float[Array, " 3"] | Float[Array, "n 3"] | None
    progress: Float[Array, ""]

    def __init__(self, vertices: Selection, positions: Numbers | None = None, displacement: Numbers | None = None):
        """**Arguments:**

        - `vertices`: a mask of shape (V,), indices of shape (n,), edges of shape (m, 2) as their ends, or a function
            from the positions at rest, shape (V, 3), to a mask.
        - `positions`: where to hold them, shape (n, 3), in the order of the indices (ascending for a mask); by default
            where they are at rest. In the unit of the mesh.
        - `displacement`: instead of `positions`, how far to move them from there: one vector, or one per vertex.

        Along a path of the supports, vertices move on straight lines.

        **Raises:** `ValueError` for both; when a problem is built, for a selection or arrays that do not fit the mesh,
        and for a vertex that another support holds elsewhere.
        """
        self.vertices = as_selection(vertices)
        self.positions = None if positions is None else jnp.asarray(positions, dtype=float)
        self.displacement = None if displacement is None else jnp.asarray(displacement, dtype=float)
        self.progress = known(np.float64(1.0))
        if positions is not None and displacement is not None:
            raise ValueError("Pinned: give positions or a displacement, not both.")

    @property
    def moves(self) -> bool:
        return self.positions is not None or self.displacement is not None

    def on(self, mesh: Mesh) -> "Pinned":
        return eqx.tree_at(lambda s: s.vertices, self, selected("Pinned", self.vertices, mesh))

    def at(self, progress: float | Float[Array, ""]) -> "Pinned":
        return eqx.tree_at(lambda s: s.progress, self, jnp.asarray(progress, dtype=float))

    def check_shapes(self, mesh: Mesh) -> None:
        n = len(selected("Pinned", self.vertices, mesh))
        _check_rows("Pinned", "positions", self.positions, [(n, 3)])
        _check_rows("Pinned", "displacement", self.displacement, [(3,), (n, 3)])

    def directions(self) -> Float[np.ndarray, "3 3"]:
        return np.eye(3)

    def points(self, mesh: Mesh) -> Float[Array, "n 3"]:
        rest = mesh.vertices[selected("Pinned", self.vertices, mesh)]
        if self.positions is not None:
            return rest + self.progress * (self.positions - rest)
        return rest if self.displacement is None else rest + self.progress * self.displacement

    def held_edges(self, mesh: Mesh) -> Int[Array, " 0"]:
        return jnp.zeros(0, jnp.int32)

    def arms(self, mesh: Mesh) -> Float[Array, "0 3"]:
        return jnp.zeros((0, 3))


class Clamped(SingleSupport):
    """Vertices held in place with the surface's normal along the edges between them, or moved together as a rigid body.

    Of every edge whose two ends are clamped the normal is held as well, as it is at rest, turned by `rotation`. That
    takes a bending energy that measures it: [`shellkit.DihedralBending`][] knows interior edges only.

    ??? cite "Source"

        With free directors and a flat sheet this is the clamped edge of Morley's plate element: L. Morley, "The
        triangular equilibrium element in the solution of plate bending problems", Aeronautical Quarterly 19 (1968).
    """

    vertices: Array | Callable
    edges: Int[Array, " m"] | None
    displacement: Float[Array, " 3"]
    rotation: Float[Array, " 3"] | None
    centre: Float[Array, " 3"] | None
    progress: Float[Array, ""]

    def __init__(
        self,
        vertices: Selection,
        displacement: Numbers | None = None,
        rotation: Numbers | None = None,
        centre: Numbers | None = None,
    ):
        """**Arguments:**

        - `vertices`: a mask of shape (V,), indices of shape (n,), edges of shape (m, 2) as their ends, or a function
            from the positions at rest, shape (V, 3), to a mask. Given edges, the normal is held along these and no
            others.
        - `displacement`: how far to move them, a vector in the unit of the mesh.
        - `rotation`: by what to turn them, vertices and normals: a rotation vector, along the axis, its length the
            angle in radians.
        - `centre`: about what point to turn; by default the mean of the clamped vertices.

        Along a path of the supports the clamp moves as a rigid body, on a straight line and about a fixed axis.

        **Raises:** `ValueError`, when a problem is built, as [`shellkit.Pinned`][].
        """
        self.vertices = as_selection(vertices)
        self.edges = None
        self.displacement = known(np.zeros(3)) if displacement is None else jnp.asarray(displacement, dtype=float)
        self.rotation = None if rotation is None else jnp.asarray(rotation, dtype=float)
        self.centre = None if centre is None else jnp.asarray(centre, dtype=float)
        self.progress = known(np.float64(1.0))

    @property
    def moves(self) -> bool:
        still = (
            self.rotation is None
            and not isinstance(self.displacement, Tracer)
            and not np.any(np.asarray(self.displacement))
        )
        return not still

    def on(self, mesh: Mesh) -> "Clamped":
        if self.edges is not None:
            return self
        indices = selected("Clamped", self.vertices, mesh), selected_edges("Clamped", self.vertices, mesh)
        return eqx.tree_at(lambda s: (s.vertices, s.edges), self, indices, is_leaf=lambda x: x is None)

    def at(self, progress: float | Float[Array, ""]) -> "Clamped":
        return eqx.tree_at(lambda s: s.progress, self, jnp.asarray(progress, dtype=float))

    def check_shapes(self, mesh: Mesh) -> None:
        for name in ("displacement", "rotation", "centre"):
            _check_rows("Clamped", name, getattr(self, name), [(3,)])

    def directions(self) -> Float[np.ndarray, "3 3"]:
        return np.eye(3)

    def points(self, mesh: Mesh) -> Float[Array, "n 3"]:
        rest = mesh.vertices[self.on(mesh).vertices]
        moved = rest
        if self.rotation is not None:
            centre = jnp.mean(rest, axis=0) if self.centre is None else self.centre
            moved = centre + _rotated(rest - centre, self.progress * self.rotation)
        return moved + self.progress * self.displacement

    def held_edges(self, mesh: Mesh) -> Int[Array, " m"]:
        return selected_edges("Clamped", self.vertices, mesh) if self.edges is None else self.edges

    def arms(self, mesh: Mesh) -> Float[Array, "m 3"]:
        edges = self.held_edges(mesh)
        along = mesh.vertices[mesh.edges[edges, 1]] - mesh.vertices[mesh.edges[edges, 0]]
        first, second = mesh.edge_faces[edges].T
        normals = face_normals(mesh.vertices, mesh)
        normals = normals[first] + jnp.where(second >= 0, 1.0, 0.0)[:, None] * normals[second]
        arms = unit(jnp.cross(along, normals))
        return arms if self.rotation is None else _rotated(arms, self.progress * self.rotation)


def _rotated(vectors: Float[Array, "n 3"], rotation: Float[Array, " 3"]) -> Float[Array, "n 3"]:
    """Rodrigues' formula, written so that it can be differentiated at no rotation."""
    square = rotation @ rotation
    small = square < 1e-6  # where two terms of the series are exact to rounding
    half = 0.5 * jnp.sqrt(jnp.where(small, 1.0, square))
    sine = jnp.where(small, 1 - square / 6, jnp.sin(2 * half) / (2 * half))
    versine = jnp.where(small, 0.5 - square / 24, 0.5 * (jnp.sin(half) / half) ** 2)
    across = jnp.cross(rotation, vectors)
    return vectors + sine * across + versine * jnp.cross(rotation, across)


def _check_rows(owner: str, name: str, value: Array | None, shapes: list[tuple[int, ...]]) -> None:
    if value is None:
        return
    if value.shape not in shapes:
        expected = " or ".join(map(str, shapes))
        raise ValueError(f"{owner}: {name} has shape {value.shape}; expected {expected}.")
    if not isinstance(value, Tracer) and not np.isfinite(value).all():
        raise ValueError(f"{owner}: {name} is not finite.")
