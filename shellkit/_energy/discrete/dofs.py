"""Degrees of freedom: how the unknowns of a scene are numbered, which of them are held, and how fields on the mesh
become vectors and vectors fields."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int, Scalar

from ..._geometry.surface import edge_lengths
from ..._mesh.mesh import Mesh
from ..._programs.tracing import known
from .frames import Frames
from .unknowns import Unknowns


class DofMap(eqx.Module):
    """The numbering of the unknowns of one scene.

    All N unknowns are the three coordinates of every vertex, in a frame of its own where it is held in oblique
    directions, then one director per edge where directors are free; the n free ones are those that are not held.

    A director is counted by its angle times a typical edge length. All unknowns are lengths then, and all derivatives
    forces: a relaxation takes the same steps whatever the unit of length.
    """

    free: Int[Array, " n"] | None  # the unknowns that are not held; None if all are free
    frames: Frames | None
    director_length: Scalar | None  # what one radian counts as; None without free directors
    n_vertices: int = eqx.field(static=True)
    n_directors: int = eqx.field(static=True)

    @classmethod
    def of(cls, mesh: Mesh, n_directors: int, held: Bool[np.ndarray, " N"], frames: Frames | None) -> "DofMap":
        """Number the unknowns on a mesh.

        **Arguments:**

        - `mesh`: the surface at rest.
        - `n_directors`: one per edge, or 0.
        - `held`: which unknowns are held.
        - `frames`: of vertices held in oblique directions; `None` if there is none.
        """
        return cls(
            free=known(np.flatnonzero(~held).astype(np.int32)) if held.any() else None,
            frames=frames,
            director_length=_mean_edge_length(mesh) if n_directors else None,
            n_vertices=mesh.n_vertices,
            n_directors=n_directors,
        )

    @property
    def size(self) -> int:
        """How many unknowns there are, held ones included."""
        return 3 * self.n_vertices + self.n_directors

    def like(self, dtype):
        """The structure of the fields that a Hessian acts on: positions, or positions and directors; a flat vector of
        the free unknowns where some are held."""
        if self.free is not None:
            return jax.ShapeDtypeStruct((len(self.free),), dtype)
        vertices = jax.ShapeDtypeStruct((self.n_vertices, 3), dtype)
        return (vertices, jax.ShapeDtypeStruct((self.n_directors,), dtype)) if self.n_directors else vertices

    def complete(self, unknowns: Unknowns) -> Unknowns:
        """The same fields, with zeros for those that are absent, and none that the scene does not have."""
        if (unknowns.directors is not None) == (self.n_directors > 0):
            return unknowns
        return Unknowns(unknowns.vertices, known(np.zeros(self.n_directors)) if self.n_directors else None)

    def pack(self, unknowns: Unknowns) -> Float[Array, " N"]:
        """The vector of all unknowns; the inverse of `unpack`."""
        vertices = unknowns.vertices if self.frames is None else self.frames.into(unknowns.vertices)
        if self.director_length is None:
            return vertices.reshape(-1)
        directors = unknowns.directors
        if directors is None:
            directors = jnp.zeros(self.n_directors, vertices.dtype)
        return jnp.concatenate([vertices.reshape(-1), self.director_length * directors])

    def unpack(self, vector: Float[Array, " N"]) -> Unknowns:
        """Fields from the vector of all unknowns."""
        vertices = vector[: 3 * self.n_vertices].reshape(-1, 3)
        vertices = vertices if self.frames is None else self.frames.out_of(vertices)
        if self.director_length is None:
            return Unknowns(vertices)
        return Unknowns(vertices, vector[3 * self.n_vertices :] / self.director_length)

    def unpack_forces(self, gradient: Float[Array, " N"]) -> Unknowns:
        """Forces at the vertices and moments on the directors, from derivatives in all unknowns."""
        forces = self.unpack(gradient)
        if forces.directors is None or self.director_length is None:
            return forces
        return Unknowns(forces.vertices, self.director_length**2 * forces.directors)

    def restrict(self, vector: Float[Array, " N"]) -> Float[Array, " n"]:
        """The free ones among all unknowns."""
        return vector if self.free is None else vector[self.free]

    def extend(self, free: Float[Array, " n"], prescribed: Float[Array, " N"]) -> Float[Array, " N"]:
        """All unknowns: the free ones as given, the others from `prescribed`."""
        return free if self.free is None else prescribed.at[self.free].set(free)

    def gather(self, unknowns: Unknowns) -> Float[Array, " n"]:
        """The vector of free unknowns."""
        return self.restrict(self.pack(unknowns))

    def motion(self, step: Float[Array, " n"]) -> Unknowns:
        """A step of the free unknowns as fields, zero where unknowns are held."""
        return self.unpack(self.extend(step, jnp.zeros(self.size, step.dtype)))

    def per_unknown(
        self, vertices: Float[Array, " V"], directors: float | Scalar | Float[Array, " E"]
    ) -> Float[Array, " n"]:
        """A number for each free unknown, from one per vertex, the same along all axes, and one per director."""
        numbers = jnp.repeat(vertices, 3)
        if self.n_directors:
            numbers = jnp.concatenate([numbers, jnp.broadcast_to(directors, self.n_directors)])
        return self.restrict(numbers)


def _mean_edge_length(mesh: Mesh) -> Array:
    if isinstance(mesh.vertices, Tracer):
        return jax.lax.stop_gradient(jnp.mean(edge_lengths(mesh.vertices, mesh)))
    ends = np.asarray(mesh.vertices)[np.asarray(mesh.edges)]
    return known(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).mean())
