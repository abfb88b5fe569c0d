"""A sheet of liquid-crystal elastomer: it stretches along its director and shrinks across it, at constant area."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._citation.papers import AHARONI_2014
from .._mesh.mesh import Mesh
from .base import SheetActuation, check_per_face
from .frames import stretched_metric


class Nematic(SheetActuation):
    r"""A nematic director in each face: stretch $\lambda$ along it, $1/\lambda$ across it.

    $$g_r = B^T \Lambda^2 B, \qquad \Lambda^2 = \tfrac12(\lambda^2+\lambda^{-2})\, 1 + \tfrac12(\lambda^2-\lambda^{-2})
    \begin{pmatrix}\cos 2\theta & \sin 2\theta\\ \sin 2\theta & -\cos 2\theta\end{pmatrix},$$

    with $g_0 = B^T B$, $B$ upper triangular. Angles $\theta$ and $\theta + \pi$ are the same state. Heated elastomers
    have $\lambda < 1$.

    ??? cite "Source"

        H. Aharoni, E. Sharon and R. Kupferman, "Geometry of thin nematic elastomer sheets", Phys. Rev. Lett. 113
        (2014), 257801; the discrete form is that of `triangulax`.
    """

    papers: ClassVar[tuple[str, ...]] = (AHARONI_2014,)
    angle: Float[Array, " F"]
    stretch: Float[Array, "..."]

    def __init__(self, angle: Float[Array, " F"], stretch: float | Array):
        """**Arguments:**

        - `angle`: of the director in each face, in radians from its first edge; see [`shellkit.director_angles`][].
        - `stretch`: along the director, one number or one per face.
        """
        self.angle = jnp.asarray(angle, dtype=float)
        self.stretch = jnp.asarray(stretch, dtype=float)

    def check(self, mesh: Mesh) -> None:
        check_per_face("Nematic", "angle", self.angle, mesh, scalar=False)
        check_per_face("Nematic", "stretch", self.stretch, mesh, scalar=True, positive=True)

    def director_fields(self) -> tuple[Float[Array, " F"], ...]:
        return (self.angle,)

    def actuated_metric(self, metric: Float[Array, "F 2 2"]) -> Float[Array, "F 2 2"]:
        return stretched_metric(metric, self.angle, self.stretch, 1 / self.stretch)

    def at(self, progress: float | Float[Array, ""]) -> "Nematic":
        """Slow heating: the stretch grows from 1 to its full value."""
        return eqx.tree_at(lambda sheet: sheet.stretch, self, 1 + progress * (self.stretch - 1))
