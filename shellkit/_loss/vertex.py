"""Losses between the relaxed vertices and given positions, one for each."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float, Int

from .._actuation.base import Actuation
from .._align.aligners import Aligner, Kabsch, checked_weights
from .._equilibrium import Equilibrium
from .._mesh.mesh import Mesh
from .base import LeastSquaresLoss


class VertexDistance(LeastSquaresLoss):
    r"""Mean squared difference of the aligned vertices' coordinates from a target's.

    Over all $3V$ of them: $\frac{1}{3} \sum_i w_i |x_i - t_i|^2$ with $w_i$ summing to one. The target is a shape of
    the same mesh; a surface of another connectivity needs a surface loss.

    **Arguments:**

    - `target`: positions of the mesh's vertices, in their order, shape `(V, 3)`.
    - `aligner`: how the relaxed vertices are laid upon the target before they are compared. Its weights are its own.
    - `weights`: one per vertex, shape `(V,)`, not negative; all equal if left out.

    **Returns:**

    When called, a scalar in the square of the vertices' unit.

    **Raises:**

    `ValueError` for a target or weights of another shape, or not finite; when checked, for those of another mesh.
    """

    target: Float[Array, "V 3"]
    aligner: Aligner
    weights: Float[Array, " V"] | None

    def __init__(
        self, target: ArrayLike | Sequence, aligner: Aligner = Kabsch(), weights: ArrayLike | Sequence | None = None
    ):
        self.target = checked_positions("VertexDistance: target", target)
        self.aligner = aligner
        self.weights = None if weights is None else checked_weights("VertexDistance", weights)

    def residuals(self, equilibrium: Equilibrium, actuation: Actuation) -> Float[Array, " m"]:
        apart = self.aligner(equilibrium.vertices, self.target) - self.target
        if self.weights is None:
            return apart.ravel() / np.sqrt(apart.size)
        return (jnp.sqrt(self.weights / (3 * jnp.sum(self.weights)))[:, None] * apart).ravel()

    def check(self, mesh: Mesh, actuation: Actuation) -> None:
        for what, found, expected in (
            ("target", self.target, (mesh.n_vertices, 3)),
            ("weights", self.weights, (mesh.n_vertices,)),
        ):
            if found is not None and found.shape != expected:
                raise ValueError(
                    f"VertexDistance: {what} is for {found.shape[0]} vertices (shape {found.shape}), but the mesh has "
                    f"{mesh.n_vertices} (shape {expected} is needed). Give one row for each vertex of the mesh, in its "
                    "order; for a surface of other connectivity use a surface loss."
                )
        jax.eval_shape(lambda: self.aligner(mesh.vertices, self.target))

    @property
    def sees_motion(self) -> bool:
        return not self.aligner.removes_motion


class LandmarkDistance(LeastSquaresLoss):
    r"""Mean squared difference of a few vertices' coordinates from where they should be.

    $\frac{1}{3k} \sum_j |x_{i_j} - t_j|^2$ over the $k$ landmarks, which alone decide the alignment. All other
    vertices are free.

    **Arguments:**

    - `indices`: the vertices, shape `(k,)`.
    - `positions`: where they should be, shape `(k, 3)`.
    - `aligner`: how the landmarks are laid upon these positions before they are compared; with fewer than three of
        them the rotation is not determined.

    **Returns:**

    When called, a scalar in the square of the vertices' unit.

    **Raises:**

    `ValueError` for shapes that do not fit each other, or positions that are not finite; when checked, for indices
    beyond the mesh.
    """

    indices: Int[Array, " k"]
    positions: Float[Array, "k 3"]
    aligner: Aligner

    def __init__(self, indices: ArrayLike | Sequence, positions: ArrayLike | Sequence, aligner: Aligner = Kabsch()):
        self.indices = jnp.asarray(indices)
        self.positions = checked_positions("LandmarkDistance: positions", positions)
        self.aligner = aligner
        if not jnp.issubdtype(self.indices.dtype, jnp.integer) or self.indices.shape != self.positions.shape[:1]:
            raise ValueError(
                f"LandmarkDistance: indices has shape {self.indices.shape} and type {self.indices.dtype}; give one "
                f"vertex number for each position, shape ({self.positions.shape[0]},)."
            )

    def residuals(self, equilibrium: Equilibrium, actuation: Actuation) -> Float[Array, " m"]:
        apart = self.aligner(equilibrium.vertices[self.indices], self.positions) - self.positions
        return apart.ravel() / np.sqrt(apart.size)

    def check(self, mesh: Mesh, actuation: Actuation) -> None:
        if not isinstance(self.indices, Tracer):
            indices = np.asarray(self.indices)
            outside = indices[(indices < 0) | (indices >= mesh.n_vertices)]
            if outside.size:
                raise ValueError(
                    f"LandmarkDistance: index {outside[0]} is not a vertex; the mesh has {mesh.n_vertices} "
                    f"(0 to {mesh.n_vertices - 1})."
                )
        jax.eval_shape(lambda: self.aligner(self.positions, self.positions))

    @property
    def sees_motion(self) -> bool:
        return not self.aligner.removes_motion


def checked_positions(what: str, positions: ArrayLike | Sequence) -> Float[Array, "n 3"]:
    positions = jnp.asarray(positions, dtype=float)
    if positions.ndim != 2 or positions.shape[1] != 3 or not positions.shape[0]:
        raise ValueError(f"{what} has shape {positions.shape}; give one row of three coordinates each, shape (n, 3).")
    if not isinstance(positions, Tracer):
        bad = np.flatnonzero(~np.isfinite(np.asarray(positions)).all(axis=1))
        if bad.size:
            raise ValueError(f"{what} is not finite in row {bad[0]}: {np.asarray(positions)[bad[0]]}.")
    return positions
