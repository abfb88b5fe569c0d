"""The Chamfer distance: between sets of points that know nothing of a surface."""

from collections.abc import Sequence
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._actuation.base import Actuation
from .._align.aligners import Aligner
from .._align.icp import ICP
from .._citation.papers import BARROW_1977
from .._equilibrium import Equilibrium
from .._geometry.closest import nearest_points
from .._mesh.mesh import Mesh
from .base import LeastSquaresLoss
from .vertex import checked_positions


class Chamfer(LeastSquaresLoss):
    r"""Mean squared distance between the relaxed vertices and a cloud of points, each to the nearest of the others.

    $$\frac{1}{V} \sum_i \min_j |x_i - t_j|^2 + \frac{1}{m} \sum_j \min_i |x_i - t_j|^2.$$

    For targets that are measured points, without faces. It sees a surface no finer than its points lie: a surface that
    is the target's in other points has a loss of about the square of their spacing. For a target with faces,
    [`shellkit.PointToSurface`][] has no such floor. Smooth, except where a point is equally near to two others: there
    the loss has a kink, downwards. There are many such places, about one per spacing.

    **Arguments:**

    - `target`: points, shape `(m, 3)`, in no order.
    - `aligner`: how the relaxed vertices are laid upon the target; by default `ICP()`.

    **Returns:**

    When called, a scalar in the square of the vertices' unit.

    **Raises:**

    `ValueError` for points of another shape or not finite.

    ??? cite

        H. G. Barrow, J. M. Tenenbaum, R. C. Bolles and H. C. Wolf, "Parametric correspondence and chamfer matching:
        two new techniques for image matching", Proceedings of IJCAI (1977), 659; here with squared distances.
    """

    papers: ClassVar[tuple[str, ...]] = (BARROW_1977,)

    target: Float[Array, "m 3"]
    aligner: Aligner

    def __init__(self, target: ArrayLike | Sequence, aligner: Aligner | None = None):
        self.target = checked_positions("Chamfer: target", target)
        self.aligner = ICP() if aligner is None else aligner

    def residuals(self, equilibrium: Equilibrium, actuation: Actuation) -> Float[Array, " n"]:
        points = self.aligner(equilibrium.vertices, self.target)
        there = points - self.target[nearest_points(points, self.target)]
        back = self.target - points[nearest_points(self.target, points)]
        return jnp.concatenate([part.ravel() / np.sqrt(part.shape[0]) for part in (there, back)])

    def check(self, mesh: Mesh, actuation: Actuation) -> None:
        jax.eval_shape(lambda: self.aligner(mesh.vertices, self.target))

    @property
    def sees_motion(self) -> bool:
        return not self.aligner.removes_motion
