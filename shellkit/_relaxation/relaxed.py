"""What a relaxation begins with, and what it leaves."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float

from .._energy import Assembly
from .._equilibrium import Diagnostics, Equilibrium, Pose
from .._mesh.mesh import Mesh
from .._programs.tracing import known, with_parts
from .._rest import RestShape
from .._solve.linear.base import LastFactor


class Start(eqx.Module):
    """Where a relaxation begins. Always of arrays: whatever it is, the program is the same."""

    vertices: Float[Array, "V 3"]
    directors: Float[Array, " E"] | None
    multipliers: Float[Array, " m"] | None

    @classmethod
    def of(cls, mesh: Mesh, assembly: Assembly, start: "Equilibrium | Start | None") -> "Start":
        """An equilibrium, or the surface at rest; what it lacks is zero."""
        found = (mesh.vertices, None, None)
        if start is not None:
            found = (start.vertices, start.directors, start.multipliers)
        zeros = lambda n: known(np.zeros(n))
        return cls(
            found[0],
            None if assembly.n_directors == 0 else zeros(assembly.n_directors) if found[1] is None else found[1],
            None if assembly.n_constraints == 0 else zeros(assembly.n_constraints) if found[2] is None else found[2],
        )


class Relaxed(eqx.Module):
    """What a relaxation leaves, of which nothing is differentiated: the shape, its free unknowns, how it was found, and
    for large problems the last factor, which is near that of the Hessian there."""

    rest: RestShape
    pose: Pose
    found: Diagnostics
    y: Float[Array, " n"]
    stuck: Bool[Array, ""]
    last: LastFactor | None

    def after(self, earlier: Diagnostics) -> "Relaxed":
        """This with the steps and factorisations of what came before."""
        more = lambda one, other: known(np.asarray(one) + np.asarray(other))
        steps = more(self.found.steps, earlier.steps)
        factorisations = more(self.found.factorisations, earlier.factorisations)
        return with_parts(self, found=with_parts(self.found, steps=steps, factorisations=factorisations))
