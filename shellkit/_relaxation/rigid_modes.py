"""Which rigid motions of a shell cost nothing: all six of a free one, fewer where supports or loads take hold."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._energy import DiscreteEnergy, DofMap, Unknowns
from .._mesh.mesh import Mesh
from .._programs.tracing import is_traced
from .._supports import Supports


_TOLERANCE = 1e-9
_HINDERED = 1e-13  # of the largest eigenvalue of what hinders motions: below it is rounding
_SAMPLES = 6  # one term may resist as many motions


class RigidModes(eqx.Module):
    """A space of rigid motions about a fixed centre, as fields on the free unknowns of a scene.

    Which combinations of the six motions leave the supports alone changes as the shell slides on them: they are found
    anew from where it is. At most `count` are free; those that are not come as zeros.
    """

    centre: Float[Array, " 3"]
    hindrances: Float[Array, "m 6"] | None  # those by terms of the energy: no motion of the space has a part in them
    units: Float[Array, " 6"]
    dofs: DofMap
    held: Float[Array, " N"] | None  # where unknowns are held; None if none is
    clamped: Int[Array, "c 2"] | None  # the ends of the edges whose normal is held; None if none is
    count: int = eqx.field(static=True)

    def __call__(self, y: Float[Array, " n"]) -> Float[Array, "n k"]:
        """The motions at free unknowns `y`, one per column. ConstrainedState unknowns are in none of them."""
        fields, free = self._fields_and_free(y)
        if free is not None:
            # Eigenvalues ascend: the first motions are those that nothing hinders.
            fields = fields @ free
        return jax.vmap(self.dofs.restrict, in_axes=1, out_axes=1)(fields)

    def are_free(self, y: Float[Array, " n"]) -> Bool[Array, ""]:
        """Whether all six motions are free."""
        free = self._fields_and_free(y)[1]
        return jnp.array(True) if free is None else jnp.all(jnp.any(free != 0, axis=0)) & (self.count == 6)

    def _fields_and_free(self, y: Float[Array, " n"]) -> tuple[Float[Array, "N 6"], Float[Array, "6 k"] | None]:
        """The six motions, and the combinations of them that are free; `None` where nothing is there to hinder any."""
        held = jnp.zeros(self.dofs.size, y.dtype) if self.held is None else self.held
        vertices = self.dofs.unpack(self.dofs.extend(y, held)).vertices
        fields = _fields(self.dofs, vertices - self.centre) * self.units
        rows = [] if self.hindrances is None else [self.hindrances]
        if self.held is not None:
            rows.append(fields.at[self.dofs.free].set(0.0))
        if self.clamped is not None:
            rows.append(_turns(vertices, self.clamped))
        if not rows:
            return fields, None
        stacked = jnp.concatenate(rows)
        sizes, axes = jnp.linalg.eigh(stacked.T @ stacked)
        free = sizes <= _HINDERED * jnp.maximum(sizes[-1], jnp.finfo(sizes.dtype).tiny)
        return fields, jnp.where(free, axes, 0.0)[:, : self.count]


def _fields(dofs: DofMap, arms: Float[Array, "V 3"]) -> Float[Array, "N 6"]:
    """The six motions as fields on all unknowns."""
    fields = rigid_fields(arms).reshape(*arms.shape, 6)
    return jax.vmap(lambda field: dofs.pack(Unknowns(field)), in_axes=2, out_axes=1)(fields)


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


def rigid_modes(energy: DiscreteEnergy, mesh: Mesh, supports: Supports | None, count: int) -> RigidModes | None:
    """The rigid motions that no support hinders and no term resists, where they are now; `None` if there is none.

    Functions of the fundamental forms resist none. Other terms are asked: a motion is free if their gradient does no
    work on it at several generic shapes.

    **Arguments:**

    - `energy`: of the scene.
    - `mesh`: the surface at rest.
    - `supports`: what is held; `None` for nothing.
    - `count`: how many the supports leave at most, see `count_rigid_modes`.
    """
    if count == 0:
        return None
    size = jnp.max(jnp.max(mesh.vertices, axis=0) - jnp.min(mesh.vertices, axis=0))
    centre = jnp.mean(mesh.vertices, axis=0)
    # Rotations are comparable with translations in the size of the mesh.
    units = jnp.concatenate([jnp.ones(3), jnp.ones(3) / size])
    held = clamped = None
    if supports is not None:
        held = energy.prescribed
        if energy.faces is not None and energy.faces.form is not None:
            # What feels the normals of edges cannot turn about those that are held.
            edges = jnp.concatenate([part.held_edges(mesh) for part in supports.parts()])
            clamped = mesh.edges[edges] if len(edges) else None
    hindrances = _work_on_motions(energy, mesh, centre, units)
    return RigidModes(centre, hindrances, units, energy.assembly.dofs, held, clamped, count)


def count_rigid_modes(mesh: Mesh, supports: Supports | None, bends: bool) -> int:
    """How many rigid motions supports leave free at most, at rest or where they lead; found on the host.

    All six where it is not known, as positions are traced: those that are hindered then come as zeros.

    **Arguments:**

    - `mesh`: the surface at rest.
    - `supports`: what is held; `None` for nothing.
    - `bends`: whether the energy feels the normals of edges, which then cannot turn about those that are held.
    """
    if supports is None:
        return 6
    if is_traced((mesh, supports)):
        return 6
    with jax.ensure_compile_time_eval():  # all is known, also where a transformation is at work
        edges = np.concatenate([np.asarray(part.held_edges(mesh)) for part in supports.parts()])
        stations = supports.stations(mesh)
    ends = np.asarray(mesh.edges)[edges] if bends else np.zeros((0, 2), int)
    # What is held in a line or a plane at rest may leave it on the way.
    return max(_count(mesh, projectors, positions, ends) for projectors, positions in stations)


def _count(
    mesh: Mesh,
    projectors: Float[np.ndarray, "V 3 3"],
    positions: Float[np.ndarray, "V 3"],
    clamped: Int[np.ndarray, "c 2"],
) -> int:
    arms = positions - positions.mean(axis=0)
    size = max(np.ptp(np.asarray(mesh.vertices), axis=0).max(), 1e-300)
    x, y, z = arms.T / size
    zero = np.zeros_like(x)
    turns = np.stack([np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], -1)
    fields = np.concatenate([np.broadcast_to(np.eye(3), (len(arms), 3, 3)), turns], axis=2)
    along = positions[clamped[:, 1]] - positions[clamped[:, 0]]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    rows = np.concatenate([(projectors @ fields).reshape(-1, 6), np.concatenate([np.zeros_like(along), along], axis=1)])
    sizes = np.linalg.svd(rows, compute_uv=False)
    return 6 - int(np.count_nonzero(sizes > _TOLERANCE * max(sizes.max(initial=0.0), 1e-300)))


def _work_on_motions(
    energy: DiscreteEnergy, mesh: Mesh, centre: Float[Array, " 3"], units: Float[Array, " 6"]
) -> Float[Array, "m 6"] | None:
    """Work of each term's gradient on the six motions, at generic shapes, relative to the size of its forces; `None`
    where no term may resist any."""
    measures = () if energy.constraints is None else energy.constraints.measures
    asked = [elements.engaged() for elements in (*energy.elements, *measures)]
    if not asked:
        return None
    scale = jnp.max(jnp.abs(mesh.vertices - centre))
    noise = jnp.sin(jnp.arange(1.0, _SAMPLES * mesh.vertices.size + 1.0) ** 2).reshape(_SAMPLES, *mesh.vertices.shape)

    def work(shape):
        motions = rigid_fields(shape - centre) * units
        rows = []
        for elements in asked:
            parts = elements.value_and_gradient(shape)[1]
            force = jnp.zeros_like(shape).at[elements.stencil].add(parts).reshape(-1)
            done = force @ motions / jnp.maximum(jnp.sum(jnp.abs(force)), jnp.finfo(force.dtype).tiny)
            rows.append(jnp.where(jnp.abs(done) > _TOLERANCE, done, 0.0))
        return jnp.stack(rows)

    rows = jax.lax.map(work, mesh.vertices + 0.1 * scale * noise)
    return jax.lax.stop_gradient(rows.reshape(-1, 6))
