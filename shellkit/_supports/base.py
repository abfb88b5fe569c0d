"""What supports are, how they add, and what they come to: unknowns held, where, and edges whose normal is held."""

import abc
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._geometry.forms import director_signs
from .._geometry.patches import ClampedSide
from .._mesh.mesh import Mesh
from .._programs.tracing import is_traced


_DEPENDENT = 1e-6  # part of a unit direction that must be new, for it to hold anything more
_DISAGREEMENT = 1e-9  # between two supports of one vertex, relative to the size of the mesh


class Supports(eqx.Module):
    """What is held of a shell; supports add: `Clamped(left) + Sliding(right, normal="x")`.

    At every vertex some directions are held, none to three of them, and some edges have their normal held. What is held
    is fixed when a problem is built; where it is held are arrays like any other, and can be trained. Supports may
    overlap as long as they agree.
    """

    @abc.abstractmethod
    def parts(self) -> tuple["SingleSupport", ...]:
        """The single supports that this one is made of."""

    @abc.abstractmethod
    def on(self, mesh: Mesh) -> "Supports":
        """The same supports with vertices and edges spelled out as indices, which a problem stores and `jit` can pass
        on.

        **Raises:** `ValueError` for a selection that does not fit the mesh.
        """

    @abc.abstractmethod
    def at(self, progress: float | Float[Array, ""]) -> "Supports":
        """These supports, their prescribed motion gone through by a fraction `progress` between 0 (at rest) and 1."""

    def __add__(self, other: "Supports") -> "SumOfSupports":
        return SumOfSupports(self.parts() + other.parts()) if isinstance(other, Supports) else NotImplemented

    def check(self, mesh: Mesh) -> None:
        """Refuse what does not fit the mesh, and supports that hold one vertex in two places.

        **Raises:** `ValueError` with the support, the vertex and the remedy.
        """
        for part in self.parts():
            part.on(mesh).check_shapes(mesh)
        if len(self.parts()) > 1 and not is_traced((self, mesh)):
            with jax.ensure_compile_time_eval():  # these numbers are known, also where a transformation is at work
                gaps = _gaps(self.on(mesh), mesh)
            for part, gap in zip(self.parts(), gaps, strict=True):
                _refuse_conflict(part.on(mesh), mesh, np.asarray(gap))

    def held_positions(self, mesh: Mesh) -> Float[Array, "V 3"]:
        """Where the vertices are held; as at rest in the directions, and at the vertices, that are not."""
        return _combine(self.parts(), mesh)[0]

    def held(self, mesh: Mesh, n_directors: int) -> Bool[np.ndarray, " N"]:
        """Which unknowns are held: three coordinates per vertex, in the frame of `frames`, then one director angle an
        edge.

        Found once on the host; not to be called inside `jit`.

        **Arguments:**

        - `mesh`: the surface at rest.
        - `n_directors`: how many director angles there are: one an edge, or 0.
        """
        _, held = _frames(_projectors(self.parts(), mesh))
        directors = np.zeros(n_directors, bool)
        if n_directors:
            for part in self.parts():
                directors[np.asarray(part.held_edges(mesh))] = True
        return np.concatenate([held.reshape(-1), directors])

    def frames(self, mesh: Mesh) -> tuple[Int[np.ndarray, " k"], Float[np.ndarray, "k 3 3"]] | None:
        """The vertices whose coordinates are counted in a frame of their own, and the axes of these frames as rows.

        They are those held in directions that are not axes of space; `None` if there is none. Found once on the host.
        """
        frames, _ = _frames(_projectors(self.parts(), mesh))
        turned = np.flatnonzero((frames != np.eye(3)).any(axis=(1, 2)))
        return (turned.astype(np.int32), frames[turned]) if len(turned) else None

    def stations(self, mesh: Mesh) -> list[tuple[Float[np.ndarray, "V 3 3"], Float[np.ndarray, "V 3"]]]:
        """The projector on the directions in which each vertex is held, and where they all are: at rest, and where the
        supports lead. Found on the host."""
        projectors = _projectors(self.parts(), mesh)
        stations = [(projectors, np.asarray(mesh.vertices))]
        if any(part.moves for part in self.parts()):
            stations.append((projectors, np.asarray(_held_positions(self.on(mesh), mesh))))
        return stations

    def continuation(self, mesh: Mesh) -> ClampedSide | None:
        """How the surface goes on beyond the edges whose normal is held; `None` if there is none."""
        held = [(part.held_edges(mesh), part) for part in self.parts()]
        held = [(edges, part) for edges, part in held if len(edges)]
        if not held:
            return None
        listed = jnp.zeros(mesh.n_edges, bool)
        arms = jnp.zeros((mesh.n_edges, 3), mesh.vertices.dtype)
        for edges, part in reversed(held):
            listed = listed.at[edges].set(True)
            arms = arms.at[edges].set(part.arms(mesh))
        sides = mesh.face_edges.T
        # Its second face sees the same edge normal, and the edge run the other way.
        return ClampedSide(listed[sides], director_signs(mesh)[:, None] * jnp.moveaxis(arms[sides], -1, 1))


class SumOfSupports(Supports):
    """Several supports at once; `terms` holds them in the order in which they were added."""

    terms: tuple["SingleSupport", ...]

    def parts(self) -> tuple["SingleSupport", ...]:
        return self.terms

    def on(self, mesh: Mesh) -> "SumOfSupports":
        return SumOfSupports(tuple(term.on(mesh) for term in self.terms))

    def at(self, progress: float | Float[Array, ""]) -> "SumOfSupports":
        return SumOfSupports(tuple(term.at(progress) for term in self.terms))


class SingleSupport(Supports):
    """A support that holds all its vertices in the same directions."""

    vertices: eqx.AbstractVar[Array | Callable]

    @property
    @abc.abstractmethod
    def moves(self) -> bool:
        """Whether it may hold its vertices elsewhere than at rest."""

    @abc.abstractmethod
    def on(self, mesh: Mesh) -> "SingleSupport":
        """The same support with vertices and edges spelled out as indices."""

    @abc.abstractmethod
    def at(self, progress: float | Float[Array, ""]) -> "SingleSupport":
        """This support, its prescribed motion gone through by a fraction `progress`."""

    @abc.abstractmethod
    def check_shapes(self, mesh: Mesh) -> None:
        """Refuse arrays that do not fit the selection; called on the support as spelled out for the mesh."""

    @abc.abstractmethod
    def directions(self) -> Float[np.ndarray, "m 3"]:
        """The directions in which the vertices are held: independent, not zero. They are no arrays to be trained."""

    @abc.abstractmethod
    def points(self, mesh: Mesh) -> Float[Array, "n 3"]:
        """Where each vertex is held; only the components along the held directions count."""

    @abc.abstractmethod
    def held_edges(self, mesh: Mesh) -> Int[Array, " m"]:
        """The edges whose normal is held."""

    @abc.abstractmethod
    def arms(self, mesh: Mesh) -> Float[Array, "m 3"]:
        """Where the surface goes on beyond each held edge, seen from its first face; square to the edge."""

    def parts(self) -> tuple["SingleSupport", ...]:
        return (self,)


def _combine(parts: tuple[SingleSupport, ...], mesh: Mesh) -> tuple[Float[Array, "V 3"], list[Float[Array, " n"]]]:
    """Where the vertices are held; and how far each part would hold its own from where others do already.

    Direction by direction: what is new in it moves the point, along that alone, to where it is wanted.
    """
    positions = mesh.vertices
    projectors = jnp.zeros((mesh.n_vertices, 3, 3), positions.dtype)
    gaps = []
    for part in parts:
        part = part.on(mesh)
        targets = part.points(mesh)
        worst = jnp.zeros(len(targets))
        for direction in part.directions():
            direction = jnp.asarray(direction / np.linalg.norm(direction))
            here, held = positions[part.vertices], projectors[part.vertices]
            new = direction - held @ direction
            square = new @ direction
            is_new = square > _DEPENDENT**2
            gap = (targets - here) @ direction
            worst = jnp.maximum(worst, jnp.where(is_new, 0.0, jnp.abs(gap)))
            inverse = jnp.where(is_new, 1.0 / jnp.where(is_new, square, 1.0), 0.0)
            positions = positions.at[part.vertices].set(here + (gap * inverse)[:, None] * new)
            projectors = projectors.at[part.vertices].add(inverse[:, None, None] * new[:, :, None] * new[:, None, :])
        gaps.append(worst)
    return positions, gaps


# Compiled once for a kind of supports, where a problem is built that has several or such as move.
@eqx.filter_jit
def _held_positions(supports: Supports, mesh: Mesh) -> Float[Array, "V 3"]:
    return supports.held_positions(mesh)


@eqx.filter_jit
def _gaps(supports: Supports, mesh: Mesh) -> list[Float[Array, " n"]]:
    return _combine(supports.parts(), mesh)[1]


def _projectors(parts: tuple[SingleSupport, ...], mesh: Mesh) -> Float[np.ndarray, "V 3 3"]:
    """The projector on the directions in which each vertex is held: on the host, as what is held is no array."""
    projectors = np.zeros((mesh.n_vertices, 3, 3))
    for part in parts:
        chosen = np.asarray(part.on(mesh).vertices)
        for direction in part.directions():
            direction = direction / np.linalg.norm(direction)
            new = direction - projectors[chosen] @ direction
            square = new @ direction
            is_new = square > _DEPENDENT**2
            inverse = np.where(is_new, 1.0 / np.where(is_new, square, 1.0), 0.0)
            projectors[chosen] += inverse[:, None, None] * new[:, :, None] * new[:, None, :]
    return projectors


def _refuse_conflict(part: SingleSupport, mesh: Mesh, gap: np.ndarray) -> None:
    size = float(np.ptp(np.asarray(mesh.vertices), axis=0).max())
    bad = np.flatnonzero(~(np.abs(gap) <= _DISAGREEMENT * size))
    if len(bad):
        raise ValueError(
            f"{type(part).__name__}: vertex {np.asarray(part.vertices)[bad[0]]} is held already, "
            f"{abs(gap[bad[0]]):.3g} away from where this support holds it; select it in one of the supports only, or "
            "make them agree."
        )


def _frames(projectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An orthonormal frame per vertex, as rows, in which coordinates are either held or free, and which are held.

    It is that of space wherever space's axes will do.
    """
    n = len(projectors)
    frames, held = np.tile(np.eye(3), (n, 1, 1)), np.diagonal(projectors, axis1=1, axis2=2) > 0.5
    straight = np.abs(projectors - held[:, :, None] * np.eye(3)).max(axis=(1, 2)) < _DEPENDENT
    oblique = np.flatnonzero(~straight)
    if len(oblique):
        values, vectors = np.linalg.eigh(projectors[oblique])
        frames[oblique], held[oblique] = np.swapaxes(vectors, 1, 2), values > 0.5
    return frames, held
