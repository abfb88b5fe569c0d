"""What a relaxation begins with, and what it leaves."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float

from .._energy import Assembly, Unknowns
from .._equilibrium import Diagnostics, Equilibrium, Pose
from .._mesh.mesh import Mesh
from .._programs.tracing import known, with_parts
from .._rest import RestShape
from .._solve.linear.base import LastFactor


class Start(eqx.Module):
    """Where a relaxation begins. Always of arrays: whatever it is, the program is the same."""

    unknowns: Unknowns
    multipliers: Float[Array, " m"] | None

    @classmethod
    def of(cls, mesh: Mesh, assembly: Assembly, start: "Equilibrium | Start | None") -> "Start":
        """An equilibrium, or the surface at rest; what it lacks is zero."""
        unknowns, multipliers = (
            (Unknowns(mesh.vertices), None) if start is None else (start.unknowns, start.multipliers)
        )
        if assembly.n_constraints == 0:
            multipliers = None
        elif multipliers is None:
            multipliers = known(np.zeros(assembly.n_constraints))
        return cls(assembly.dofs.complete(unknowns), multipliers)


class Relaxed(eqx.Module):
    """What a relaxation leaves, of which nothing is differentiated: the shape, its free unknowns, how it was found, and
    for large problems the last factor, which is near that of the Hessian there."""

    rest: RestShape
    pose: Pose
    found: Diagnostics
    y: Float[Array, " n"]
    stuck: Bool[Array, ""]
    last: LastFactor | None

    @property
    def start(self) -> Start:
        """Where a relaxation begins that goes on from here."""
        return Start(self.pose.unknowns, self.pose.multipliers)

    def after(self, earlier: Diagnostics) -> "Relaxed":
        """This with the steps and factorisations of what came before."""
        more = lambda one, other: known(np.asarray(one) + np.asarray(other))
        steps = more(self.found.steps, earlier.steps)
        factorisations = more(self.found.factorisations, earlier.factorisations)
        return with_parts(self, found=with_parts(self.found, steps=steps, factorisations=factorisations))
