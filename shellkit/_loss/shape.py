"""Losses on the form of the relaxed surface alone, wherever it lies and however large it is."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._actuation.base import Actuation
from .._citation.papers import CLAUSSEN
from .._equilibrium import Equilibrium
from .._geometry.rowwise import length
from .._geometry.surface import vertex_areas
from .base import LeastSquaresLoss


class Sphericity(LeastSquaresLoss):
    r"""How far the relaxed surface is from a sphere of any radius, anywhere.

    It is the variance of the relative distance from the centre: $\sum_i w_i (r_i / \bar r - 1)^2$ with $r_i = |x_i -
    c|$, $c = \sum_i w_i x_i$, $\bar r = \sum_i w_i r_i$, and $w_i$ the barycentric areas of the relaxed surface,
    summing to one. The gradient goes through the weights.

    Zero exactly when all vertices lie on a sphere about their weighted mean. For surfaces that are star-shaped to
    begin with, or nearly so: a sphere that is covered several times counts as one. Not smooth where a vertex lies on
    the centre; the gradient given there is finite.

    **Returns:**

    When called, a scalar without unit.

    ??? cite "Source"

        The loss of the head in the inverse-design tutorial of N. Claussen's `triangulax`.
    """

    papers: ClassVar[tuple[str, ...]] = (CLAUSSEN,)

    def residuals(self, equilibrium: Equilibrium, actuation: Actuation) -> Float[Array, " m"]:
        vertices = equilibrium.vertices
        areas = vertex_areas(vertices, equilibrium.mesh)
        weights = areas / jnp.sum(areas)
        radii = length(vertices - weights @ vertices)
        return jnp.sqrt(weights) * (radii / (weights @ radii) - 1)

    @property
    def sees_motion(self) -> bool:
        return False
