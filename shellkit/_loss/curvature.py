"""Losses on the curvature of the relaxed surface, against a constant or a value for each vertex."""

from collections.abc import Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

from .._actuation.base import Actuation
from .._citation.papers import COHEN_STEINER_2003, MEYER_2003
from .._equilibrium import Equilibrium
from .._geometry.curvature import gauss_curvature, mean_curvature, voronoi_areas
from .._geometry.rowwise import root
from .._mesh.mesh import Mesh
from .base import LeastSquaresLoss


class MeanCurvature(LeastSquaresLoss):
    r"""Mean squared difference of the relaxed surface's mean curvature from a target.

    $\sum_i w_i (H_i - H^*_i)^2$ over the vertices off the boundary, with $H_i$ of [`shellkit.mean_curvature`][] and
    $w_i$ their areas on the relaxed surface (`voronoi_areas`), summing to one; the gradient goes through
    these. It jumps where a corner of a face passes 90°, and the loss itself where a hinge is folded to 180°.

    **Arguments:**

    - `target`: the mean curvature wanted, shape `()` or `(V,)`, in the inverse of the vertices' unit; positive where
        the surface is convex seen from outside (1 on a unit sphere).

    **Returns:**

    When called, a scalar in the inverse square of the vertices' unit.

    **Raises:**

    `ValueError` for a target that is not finite or of another shape; when checked, for one of another mesh.
    """

    papers: ClassVar[tuple[str, ...]] = (COHEN_STEINER_2003, MEYER_2003)
    target: Float[Array, " *V"]

    def __init__(self, target: ArrayLike | Sequence):
        self.target = _checked_target("MeanCurvature", target)

    def residuals(self, equilibrium: Equilibrium, actuation: Actuation) -> Float[Array, " m"]:
        found = mean_curvature(equilibrium.vertices, equilibrium.mesh)
        return _root_shares(equilibrium) * (found - self.target)

    def check(self, mesh: Mesh, actuation: Actuation) -> None:
        _refuse_other_mesh("MeanCurvature", self.target, mesh)

    @property
    def sees_motion(self) -> bool:
        return False


class GaussCurvature(LeastSquaresLoss):
    r"""Mean squared difference of the relaxed surface's Gauss curvature from a target.

    $\sum_i w_i (K_i - K^*_i)^2$ over the vertices off the boundary, with $K_i$ of [`shellkit.gauss_curvature`][] and
    $w_i$ their areas on the relaxed surface (`voronoi_areas`), summing to one; the gradient goes through
    these. It jumps where a corner of a face passes 90°.

    **Arguments:**

    - `target`: the Gauss curvature wanted, shape `()` or `(V,)`, in the inverse square of the vertices' unit. On a
        closed surface its integral is $2\pi\chi$ whatever the shape: a target of another integral cannot be met.

    **Returns:**

    When called, a scalar in the inverse fourth power of the vertices' unit.

    **Raises:**

    `ValueError` for a target that is not finite or of another shape; when checked, for one of another mesh.
    """

    papers: ClassVar[tuple[str, ...]] = (MEYER_2003,)
    target: Float[Array, " *V"]

    def __init__(self, target: ArrayLike | Sequence):
        self.target = _checked_target("GaussCurvature", target)

    def residuals(self, equilibrium: Equilibrium, actuation: Actuation) -> Float[Array, " m"]:
        found = gauss_curvature(equilibrium.vertices, equilibrium.mesh)
        return _root_shares(equilibrium) * (found - self.target)

    def check(self, mesh: Mesh, actuation: Actuation) -> None:
        _refuse_other_mesh("GaussCurvature", self.target, mesh)

    @property
    def sees_motion(self) -> bool:
        return False


def _root_shares(equilibrium: Equilibrium) -> Float[Array, " V"]:
    """Square roots of the vertices' shares of the area off the boundary, where discrete curvature means something."""
    mesh = equilibrium.mesh
    areas = voronoi_areas(equilibrium.vertices, mesh)
    counted = jnp.where(mesh.boundary_vertices, 0.0, areas)
    return root(counted / jnp.sum(counted))


def _checked_target(name: str, target: ArrayLike | Sequence) -> Float[Array, " *V"]:
    target = jnp.asarray(target, dtype=float)
    if target.ndim > 1:
        raise ValueError(f"{name}: target has shape {target.shape}; give one number, or one per vertex, shape (V,).")
    if not isinstance(target, Tracer):
        bad = np.flatnonzero(~np.isfinite(np.atleast_1d(np.asarray(target))))
        if bad.size:
            raise ValueError(f"{name}: target is not finite at {bad[0]}; give finite curvatures.")
    return target


def _refuse_other_mesh(name: str, target: Array, mesh: Mesh) -> None:
    if target.shape not in ((), (mesh.n_vertices,)):
        raise ValueError(
            f"{name}: target has shape {target.shape}, but the mesh has {mesh.n_vertices} vertices; give one number, "
            f"or one per vertex, shape ({mesh.n_vertices},)."
        )
    if not isinstance(mesh.edges, Tracer) and bool(np.asarray(mesh.boundary_vertices).all()):
        raise ValueError(f"{name}: all vertices lie on the boundary, which has no curvature; refine the mesh.")
