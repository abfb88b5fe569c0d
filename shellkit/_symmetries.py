"""Which rigid motions of a shell cost nothing: all six of a free one, fewer where supports or loads take hold."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ._energy import AbstractEnergy, Assembly, DiscreteEnergy, EnergyTerm
from ._mesh.mesh import Mesh
from ._rest import RestShape


_TOLERANCE = 1e-9
_SAMPLES = 3


class FreeMotions(eqx.Module):
    """A space of rigid motions about a fixed centre, as fields on the free unknowns of a scene."""

    centre: Float[Array, " 3"]
    coefficients: Float[Array, "6 k"]
    assembly: Assembly
    all_rigid: bool = eqx.field(static=True)

    def __call__(self, y: Float[Array, " n"]) -> Float[Array, "n k"]:
        """The motions at free unknowns `y`, one a column. Held unknowns are in none of them."""
        vertices, _ = self.assembly.split(self.assembly.extend(y, jnp.zeros(self.assembly.size, y.dtype)))
        fields = rigid_fields(vertices - self.centre) @ self.coefficients
        still = jnp.zeros((self.assembly.n_directors, fields.shape[1]), y.dtype)
        return jax.vmap(self.assembly.restrict, in_axes=1, out_axes=1)(jnp.concatenate([fields, still]))


def rigid_fields(arms: Float[Array, "V 3"]) -> Float[Array, "V*3 6"]:
    """Three translations and three rotations about the origin of `arms`, as flat displacement fields."""
    zero = jnp.zeros_like(arms[:, 0])
    x, y, z = arms.T
    fields = [jnp.broadcast_to(axis, arms.shape) for axis in jnp.eye(3, dtype=arms.dtype)]
    fields += [jnp.column_stack(f) for f in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return jnp.stack(fields, axis=-1).reshape(-1, 6)


def free_motions(
    energy: AbstractEnergy,
    mesh: Mesh,
    rest: RestShape,
    assembly: Assembly,
    held: Bool[np.ndarray, " N"] | None = None,
) -> FreeMotions | None:
    """The rigid motions that no support hinders and no term resists, or `None` if there is none.

    Functions of the fundamental forms resist none. Other terms are asked: a motion is free if their gradient does no
    work on it at several generic shapes.
    """
    centre = jnp.mean(mesh.vertices, axis=0)
    hindrances = []
    if held is not None:
        fields = np.asarray(rigid_fields(mesh.vertices - centre))
        hindrances.append(fields[held[: len(fields)]])
    own = [term for _, term in energy.weighted_terms() if isinstance(term, EnergyTerm)]
    if own:
        hindrances.append(_work_on_motions(own, mesh, rest, centre))
    coefficients = np.eye(6)
    if hindrances:
        rows = np.concatenate(hindrances) * _units(mesh, centre)
        _, sizes, motions = np.linalg.svd(rows)
        rank = int(np.count_nonzero(sizes > _TOLERANCE * max(sizes.max(initial=0.0), 1e-300)))
        coefficients = motions[rank:].T * _units(mesh, centre)[:, None]
    if coefficients.shape[1] == 0:
        return None
    return FreeMotions(centre, jnp.asarray(coefficients), assembly, coefficients.shape[1] == 6)


def _units(mesh: Mesh, centre: Array) -> np.ndarray:
    """What makes rotations comparable with translations: the size of the mesh."""
    size = float(jnp.max(jnp.abs(mesh.vertices - centre)))
    return np.array([1.0, 1.0, 1.0, 1 / size, 1 / size, 1 / size])


def _work_on_motions(terms: list[EnergyTerm], mesh: Mesh, rest: RestShape, centre: Array) -> np.ndarray:
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
            work = force @ np.asarray(rigid_fields(shape - centre))
            effort = np.abs(force).sum() * _effort(scale)
            rows.append(
                np.where(np.abs(work) > _TOLERANCE * np.maximum(effort, 1e-300), work / np.maximum(effort, 1e-300), 0.0)
            )
    return np.array(rows)


def _effort(scale: float) -> np.ndarray:
    return np.array([1.0, 1.0, 1.0, scale, scale, scale])
