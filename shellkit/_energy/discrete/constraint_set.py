"""The constraints of one scene at given parameters: what they measure, what it ought to be, and the forces that hold
it."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Scalar

from ..._mesh.mesh import Mesh
from ..._rest import RestShape
from ..base import EnergyTerm
from ..constraints import Constraint
from .elements import Elements


class Constraints(eqx.Module):
    r"""Quantities $s$ with residuals $c = s - s_0$, and the energy that holds them, $\sum -p\,c + \tfrac12 k\,c^2$.

    Springs have their own stiffness $k$ and no multiplier $p$. Those held exactly start with neither, and are
    given estimates of both while the multiplier is sought.
    """

    measures: tuple[Elements, ...]
    targets: Float[Array, " m"]
    compliances: Float[Array, " m"]  # of the springs; zero for what is held exactly
    multipliers: Float[Array, " m"]
    penalties: Float[Array, " m"]
    exact: tuple[bool, ...] = eqx.field(static=True)

    @classmethod
    def of(cls, constraints: Sequence[Constraint], stencils: tuple[Array, ...], mesh: Mesh, rest: RestShape):
        """Bind constraints to a mesh; `None` if there is none."""
        if not constraints:
            return None
        measures, targets = [], []
        for constraint, stencil in zip(constraints, stencils, strict=True):
            measure: EnergyTerm = constraint.measure()
            measures.append(Elements(measure, None, measure.element_data(mesh, rest), stencil))
            targets.append(constraint.target(measures[-1].energy(mesh.vertices)))
        stiffness = jnp.stack([jnp.asarray(0.0 if c.stiffness is None else c.stiffness) for c in constraints])
        return cls(
            measures=tuple(measures),
            targets=jnp.stack(targets),
            compliances=jnp.where(stiffness > 0, 1 / jnp.where(stiffness > 0, stiffness, 1.0), 0.0),
            multipliers=jnp.zeros(len(constraints)),
            penalties=stiffness,
            exact=tuple(constraint.stiffness is None for constraint in constraints),
        )

    def with_multipliers(self, multipliers: Float[Array, " m"], penalties: Float[Array, " m"]) -> "Constraints":
        """The same quantities, held by other forces."""
        return eqx.tree_at(lambda q: (q.multipliers, q.penalties), self, (multipliers, penalties))

    def residuals(self, vertices: Float[Array, "V 3"]) -> Float[Array, " m"]:
        """By how much each exceeds its value."""
        return jnp.stack([measure.energy(vertices) for measure in self.measures]) - self.targets

    def energy(self, residuals: Float[Array, " m"]) -> Scalar:
        """Of the forces that hold them."""
        return jnp.sum((0.5 * self.penalties * residuals - self.multipliers) * residuals)

    def forces(self, residuals: Float[Array, " m"]) -> Float[Array, " m"]:
        """The derivative of that energy in each gap."""
        return self.penalties * residuals - self.multipliers
