"""Vertices that slide in planes or along lines, and planes of symmetry."""

from collections.abc import Callable
from typing import TypeAlias

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._mesh.mesh import Mesh
from .._programs.tracing import known
from .base import SingleSupport
from .selection import Numbers, Selection, as_selection, selected


Direction: TypeAlias = tuple[float, float, float]

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_FLAT = 1e-6  # how far from a plane a vertex may lie, relative to the size of the mesh


class Sliding(SingleSupport):
    """Vertices that slide in planes or along lines, each through its own place at rest; the surface may turn there.

    A simply supported plate in the plane z = 0 is `Sliding(boundary, normal="z")`.
    """

    vertices: Array | Callable
    normal: Direction | None = eqx.field(static=True)
    along: Direction | None = eqx.field(static=True)
    displacement: Float[Array, " 3"] | Float[Array, "n 3"] | None
    progress: Float[Array, ""]

    def __init__(
        self,
        vertices: Selection,
        normal: str | Numbers | None = None,
        along: str | Numbers | None = None,
        displacement: Numbers | None = None,
    ):
        """**Arguments:**

        - `vertices`: a mask of shape (V,), indices of shape (n,), edges of shape (m, 2) as their ends, or a function
            from the positions at rest, shape (V, 3), to a mask.
        - `normal`: of the planes: `"x"`, `"y"`, `"z"` or a vector of any length.
        - `along`: instead, the direction of the lines.
        - `displacement`: by what planes or lines are moved: one vector, or one per vertex. Its part within them has no
            effect.

        Along a path of the supports, planes and lines move evenly.

        **Raises:** `ValueError` for both of `normal` and `along`, or neither, or one that is zero; when a problem is
        built, as [`shellkit.Pinned`][].
        """
        if (normal is None) == (along is None):
            raise ValueError(
                "Sliding: give the normal of the planes, or the direction along the lines: one of the two."
            )
        self.vertices = as_selection(vertices)
        self.normal = None if normal is None else _direction("Sliding", "normal", normal)
        self.along = None if along is None else _direction("Sliding", "along", along)
        self.displacement = None if displacement is None else jnp.asarray(displacement, dtype=float)
        self.progress = known(np.float64(1.0))

    @property
    def moves(self) -> bool:
        return self.displacement is not None

    def on(self, mesh: Mesh) -> "Sliding":
        return eqx.tree_at(lambda s: s.vertices, self, selected("Sliding", self.vertices, mesh))

    def at(self, progress: float | Float[Array, ""]) -> "Sliding":
        return eqx.tree_at(lambda s: s.progress, self, jnp.asarray(progress, dtype=float))

    def check_shapes(self, mesh: Mesh) -> None:
        n = len(selected("Sliding", self.vertices, mesh))
        if self.displacement is not None and self.displacement.shape not in [(3,), (n, 3)]:
            raise ValueError(f"Sliding: displacement has shape {self.displacement.shape}; expected (3,) or ({n}, 3).")

    def directions(self) -> Float[np.ndarray, "m 3"]:
        if self.normal is not None:
            return np.array([self.normal])
        along = np.array(self.along)
        others = np.argsort(np.abs(along))[:2]
        return np.eye(3)[others] - along[others, None] * along

    def points(self, mesh: Mesh) -> Float[Array, "n 3"]:
        rest = mesh.vertices[selected("Sliding", self.vertices, mesh)]
        return rest if self.displacement is None else rest + self.progress * self.displacement

    def held_edges(self, mesh: Mesh) -> Int[Array, " 0"]:
        return jnp.zeros(0, jnp.int32)

    def arms(self, mesh: Mesh) -> Float[Array, "0 3"]:
        return jnp.zeros((0, 3))


class Symmetry(SingleSupport):
    """A plane of symmetry: the mesh is one half, and its mirror image is thought to go on beyond the plane.

    The vertices stay in the plane, and so does the normal of the edges between them. The equilibrium is that of the
    whole mirrored mesh, as far as that is symmetric; energies and forces are those of the half.
    """

    vertices: Array | Callable
    normal: Direction = eqx.field(static=True)
    edges: Int[Array, " m"] | None

    def __init__(self, vertices: Selection, normal: str | Numbers):
        """**Arguments:**

        - `vertices`: those on the plane: a mask of shape (V,), indices of shape (n,), edges of shape (m, 2) as their
            ends, or a function from the positions at rest, shape (V, 3), to a mask. They must lie in one plane, on the
            boundary.
        - `normal`: of the plane: `"x"`, `"y"`, `"z"` or a vector of any length and sign.

        **Raises:** `ValueError` for a normal that is zero; when a problem is built, for vertices that do not lie in one
        plane, or a mesh on both sides of it.
        """
        self.vertices = as_selection(vertices)
        self.normal = _direction("Symmetry", "normal", normal)
        self.edges = None

    @property
    def moves(self) -> bool:
        return False

    def on(self, mesh: Mesh) -> "Symmetry":
        if self.edges is not None:
            return self
        vertices = selected("Symmetry", self.vertices, mesh)
        inside = np.zeros(mesh.n_vertices, bool)
        inside[np.asarray(vertices)] = True
        edges = np.flatnonzero(inside[np.asarray(mesh.edges)].all(axis=1) & np.asarray(mesh.boundary_edges))
        indices = vertices, known(edges.astype(np.int32))
        return eqx.tree_at(lambda s: (s.vertices, s.edges), self, indices, is_leaf=lambda x: x is None)

    def at(self, progress: float | Float[Array, ""]) -> "Symmetry":
        return self

    def check_shapes(self, mesh: Mesh) -> None:
        normal = np.array(self.normal)
        heights = np.asarray(mesh.vertices) @ normal
        chosen = np.asarray(self.vertices)
        heights = heights - heights[chosen].mean()
        tolerance = _FLAT * float(np.ptp(np.asarray(mesh.vertices), axis=0).max())
        off = chosen[np.abs(heights[chosen]) > tolerance]
        if len(off):
            raise ValueError(
                f"Symmetry: vertex {off[0]} lies {abs(heights[off[0]]):.3g} off the plane through the mean of the "
                "selected vertices; select those on the plane only, and give the normal of that plane."
            )
        rising, falling = np.flatnonzero(heights > tolerance), np.flatnonzero(heights < -tolerance)
        if len(rising) and len(falling):
            raise ValueError(
                f"Symmetry: the mesh lies on both sides of the plane, vertex {rising[0]} on one and vertex "
                f"{falling[0]} on the other; give one half of it."
            )
        flat = np.flatnonzero((np.abs(heights) <= tolerance)[np.asarray(mesh.faces)].all(axis=1))
        if len(flat):
            raise ValueError(f"Symmetry: face {flat[0]} lies in the plane, where its mirror image would cover it.")

    def directions(self) -> Float[np.ndarray, "1 3"]:
        return np.array([self.normal])

    def points(self, mesh: Mesh) -> Float[Array, "n 3"]:
        return mesh.vertices[self.on(mesh).vertices]

    def held_edges(self, mesh: Mesh) -> Int[Array, " m"]:
        edges = self.on(mesh).edges
        assert edges is not None
        return edges

    def arms(self, mesh: Mesh) -> Float[Array, "m 3"]:
        edges = self.held_edges(mesh)
        face, corner = mesh.edge_faces[edges, 0], mesh.edge_corners[edges, 0]
        inward = mesh.vertices[mesh.faces[face, corner]] - mesh.vertices[mesh.edges[edges, 0]]
        normal = jnp.array(self.normal)
        return -jnp.sign(inward @ normal)[:, None] * normal


def _direction(owner: str, name: str, value: str | Numbers) -> Direction:
    """A unit vector. It says what is held, which does not change once per problem is built: hence no array."""
    if isinstance(value, str) and value not in _AXES:
        raise ValueError(f"{owner}: {name} is {value!r}; give 'x', 'y', 'z' or a vector.")
    vector = np.array(_AXES[value] if isinstance(value, str) else value, dtype=float)
    if vector.shape != (3,):
        raise ValueError(f"{owner}: {name} has shape {vector.shape}; expected a vector, shape (3,).")
    if not (np.isfinite(vector).all() and vector.any()):
        raise ValueError(f"{owner}: {name} is {vector.tolist()}; expected a finite vector that is not zero.")
    x, y, z = vector / np.linalg.norm(vector)
    return float(x), float(y), float(z)
