"""What a shell can do: its unknowns as fields on the mesh."""

import equinox as eqx
from jaxtyping import Array, Float


class Unknowns(eqx.Module):
    """The unknowns of a scene as fields; likewise motions, and the forces that act along them.

    A further unknown is a field here, and is numbered in [`shellkit._energy.discrete.dofs.DofMap`][].
    """

    vertices: Float[Array, "V 3"]
    """Positions, in the unit of the mesh."""
    directors: Float[Array, " E"] | None = None
    """Angles by which edge normals are turned, in radians; `None` where directors are not free, or all are zero."""
