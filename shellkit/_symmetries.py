"""Which rigid motions of a shell cost nothing: all six of a free one, fewer where supports or loads take hold."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ._energy import AbstractEnergy, Assembly, Constraint, DiscreteEnergy, EnergyTerm, FormEnergy
from ._mesh.mesh import Mesh
from ._rest import RestShape
from ._supports import Supports


_TOLERANCE = 1e-9
_SAMPLES = 6  # one term may resist as many motions


class FreeMotions(eqx.Module):
    """A space of rigid motions about a fixed centre, as fields on the free unknowns of a scene.

    Which combinations of the six motions leave the supports alone changes as the shell slides on them: they are found
    anew from where it is.
    """

    centre: Float[Array, " 3"]
    hindrances: Float[Array, "m 6"]  # those by terms of the energy: no motion of the space has a part in them
    units: Float[Array, " 6"]
    assembly: Assembly
    held: Float[Array, " N"] | None  # where unknowns are held; None if none is
    clamped: Int[Array, "c 2"] | None  # the ends of the edges whose normal is held; None if none is
    count: int = eqx.field(static=True)

    def __call__(self, y: Float[Array, " n"]) -> Float[Array, "n k"]:
        """The motions at free unknowns `y`, one a column. Held unknowns are in none of them."""
        held = jnp.zeros(self.assembly.size, y.dtype) if self.held is None else self.held
        vertices, _ = self.assembly.split(self.assembly.extend(y, held))
        fields = _fields(self.assembly, vertices - self.centre) * self.units
        rows = self.hindrances
        if self.held is not None:
            at_supports = fields.at[self.assembly.free].set(0.0)
            rows = jnp.concatenate([rows, at_supports])
        if self.clamped is not None:
            rows = jnp.concatenate([rows, _turns(vertices, self.clamped)])
        if self.count < 6:
            # Eigenvalues ascend: the first motions are those that nothing hinders.
            fields = fields @ jnp.linalg.eigh(rows.T @ rows)[1][:, : self.count]
        return jax.vmap(self.assembly.restrict, in_axes=1, out_axes=1)(fields)

    @property
    def all_rigid(self) -> bool:
        """Whether all six motions are free."""
        return self.count == 6


def _fields(assembly: Assembly, arms: Float[Array, "V 3"]) -> Float[Array, "N 6"]:
    """The six motions as fields on all unknowns."""
    fields = rigid_fields(arms).reshape(*arms.shape, 6)
    return jax.vmap(lambda field: assembly.join(field, None), in_axes=2, out_axes=1)(fields)


def rigid_fields(arms: Float[Array, "V 3"]) -> Float[Array, "V*3 6"]:
    """Three translations and three rotations about the origin of `arms`, as flat displacement fields."""
    zero = jnp.zeros_like(arms[:, 0])
    x, y, z = arms.T
    fields = [jnp.broadcast_to(axis, arms.shape) for axis in jnp.eye(3, dtype=arms.dtype)]
    fields += [jnp.column_stack(f) for f in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return jnp.stack(fields, axis=-1).reshape(-1, 6)


def _turns(vertices: Float[Array, "V 3"], edges: Int[Array, "m 2"]) -> Float[Array, "m 6"]:
    """By how much the six motions turn the surface about edges, whose normal stays."""
    along = vertices[edges[:, 1]] - vertices[edges[:, 0]]
    return jnp.concatenate([jnp.zeros_like(along), along / jnp.linalg.norm(along, axis=1, keepdims=True)], axis=1)


def free_motions(
    energy: AbstractEnergy,
    mesh: Mesh,
    rest: RestShape,
    assembly: Assembly,
    supports: Supports | None = None,
) -> FreeMotions | None:
    """The rigid motions that no support hinders and no term resists, or `None` if there is none.

    Functions of the fundamental forms resist none. Other terms are asked: a motion is free if their gradient does no
    work on it at several generic shapes.
    """
    centre, units = jnp.mean(mesh.vertices, axis=0), _units(mesh)
    terms = [term for _, term in energy.weighted_terms()]
    own = [term.engaged() for term in terms if isinstance(term, EnergyTerm)]
    own += [term.measure() for term in terms if isinstance(term, Constraint)]
    hindrances = _work_on_motions(own, mesh, rest, centre, units) if own else np.zeros((0, 6))
    rows, held, clamped = hindrances, None, None
    if supports is not None:
        # What is held in a line or a plane at rest may leave it on the way.
        positions = [supports.at(0.0).held_positions(mesh), supports.held_positions(mesh)]
        fields = [np.asarray(_fields(assembly, x - centre)) * units for x in positions]
        rows = np.concatenate([rows, *(field[assembly.is_held] for field in fields)])
        held = assembly.join(positions[1], None)
        if any(isinstance(term, FormEnergy) and term.form is not None for _, term in energy.weighted_terms()):
            # What feels the normals of edges cannot turn about those that are held.
            edges = np.concatenate([np.asarray(part.held_edges(mesh)) for part in supports.parts()])
            clamped = mesh.edges[edges] if len(edges) else None
        if clamped is not None:
            rows = np.concatenate([rows, *(_turns(x, clamped) for x in positions)])
    sizes = np.linalg.svd(rows, compute_uv=False) if len(rows) else np.zeros(0)
    count = 6 - int(np.count_nonzero(sizes > _TOLERANCE * max(sizes.max(initial=0.0), 1e-300)))
    if count == 0:
        return None
    return FreeMotions(centre, jnp.asarray(hindrances), jnp.asarray(units), assembly, held, clamped, count)


def _units(mesh: Mesh) -> np.ndarray:
    """What makes rotations comparable with translations: the size of the mesh."""
    size = float(jnp.max(jnp.ptp(mesh.vertices, axis=0)))
    return np.array([1.0, 1.0, 1.0, 1 / size, 1 / size, 1 / size])


def _work_on_motions(
    terms: list[EnergyTerm], mesh: Mesh, rest: RestShape, centre: Array, units: np.ndarray
) -> np.ndarray:
    """Work of each term's gradient on the six motions, at generic shapes, relative to the size of its forces."""
    rng = np.random.default_rng(0)
    scale = float(jnp.max(jnp.abs(mesh.vertices - centre)))
    rows = []
    for term in terms:
        assembly = Assembly.of(term, mesh)
        gradient = eqx.filter_jit(DiscreteEnergy(term, mesh, rest, assembly, jnp.zeros(assembly.size)).gradient)
        for _ in range(_SAMPLES):
            shape = mesh.vertices + 0.05 * scale * rng.normal(size=mesh.vertices.shape)
            force = np.asarray(gradient(shape.reshape(-1)))
            work = force @ np.asarray(rigid_fields(shape - centre)) * units
            work = work / max(np.abs(force).sum(), 1e-300)
            rows.append(np.where(np.abs(work) > _TOLERANCE, work, 0.0))
    return np.array(rows)
