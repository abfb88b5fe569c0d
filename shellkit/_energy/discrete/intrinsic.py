"""Derivatives in the intrinsic numbers of a face, its squared edge lengths and half hinge angles, from those in the
components of its two forms.

The terms of a sum are differentiated in the latter by automatic differentiation, elementwise over all faces. What leads
from there to the numbers is the same for all terms, and written by hand: it is a tenth of the operations, and of the
time to compile them.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._geometry.forms import BEND, BEND_SLOPES, CurvatureForm, determinant, metric_from_lengths


Density = Callable[..., Float[Array, " F"]]
"""The energy of every face as a function of components of its forms, each an array of shape `(F,)`."""


class Bends(eqx.Module):
    r"""What edge i adds to the curvature form of its face, $s_i = 2 h_i f(\omega_i)$, with its derivatives.

    With $A$ twice the area and $\ell_i$ the squared length, $h_i = A / \sqrt{\ell_i}$, so that

    $$\frac{\partial s_i}{\partial \ell_j} = s_i \left(p_j - \frac{\delta_{ij}}{2\ell_i}\right), \qquad
    p_j = \frac{1}{2 A^2} \frac{\partial A^2}{\partial \ell_j},$$

    where $A^2$, by Heron's formula, is a quadratic function of the squared lengths.
    """

    heights: Float[Array, "3 F"]  # 2 h_i
    values: Float[Array, "3 F"]
    slopes: Float[Array, "3 F"]  # the derivative in the half angle
    spread: Float[Array, "3 F"]  # p_j
    halved: Float[Array, "3 F"]  # 1 / (2 l_i)
    squared_area: Float[Array, " F"]  # A squared
    form: CurvatureForm = eqx.field(static=True)

    def __init__(self, squared_lengths: Float[Array, "3 F"], half_angles: Float[Array, "3 F"], form: CurvatureForm):
        metric = metric_from_lengths(squared_lengths)
        self.form = form
        self.squared_area = determinant(metric)
        self.halved = 0.5 / squared_lengths
        self.spread = jnp.stack([metric[1], metric[0] - metric[1], metric[2] - metric[1]]) / (2 * self.squared_area)
        self.heights = 2 * jnp.sqrt(self.squared_area / squared_lengths)
        self.values = self.heights * BEND[form](half_angles)
        self.slopes = self.heights * BEND_SLOPES[form](half_angles)[0]

    def stress(self, on_lengths: Float[Array, "3 F"], on_bends: Float[Array, "3 F"]) -> Float[Array, "6 F"]:
        """First derivatives in lengths and half angles from those in lengths and bends."""
        work = on_bends * self.values
        on_lengths = on_lengths + _sum(work) * self.spread - work * self.halved
        return jnp.concatenate([on_lengths, on_bends * self.slopes])

    def second(
        self, on_bends: Float[Array, "3 F"], hessian: Float[Array, "6 6 F"], turns: Float[Array, "3 F"]
    ) -> Float[Array, "6 6 F"]:
        """Second derivatives in lengths and half angles from those in lengths and bends, and from the first in bends.

        **Arguments:**

        - `on_bends`, `hessian`: first and second derivatives.
        - `turns`: the second derivative of $f$ in the half angle.
        """
        unit = jnp.eye(3)[:, :, None]
        rates = self.spread - unit * self.halved[:, None]  # [i, j]: of the logarithm of s_i in l_j
        slope = self.values[:, None] * rates
        work = on_bends * self.values
        force, total = work * self.halved, _sum(work)
        # Stress times the second derivatives of the bends.
        lengths = (
            total * ((0.5 - unit) / (2 * self.squared_area) - self.spread[:, None] * self.spread)
            - force[:, None] * self.spread - self.spread[:, None] * force
            + 3 * unit * (force * self.halved)
        )  # fmt: skip
        mixed = rates * (on_bends * self.slopes)[:, None]
        angles = unit * (on_bends * self.heights * turns)
        # And the chain rule for the second derivatives of the energy.
        among, between, bends = hessian[:3, :3], hessian[:3, 3:], hessian[3:, 3:]
        carried = _product(bends, slope)
        coupled = _product(between, slope)
        lengths = lengths + among + coupled + jnp.swapaxes(coupled, 0, 1) + _product(jnp.swapaxes(slope, 0, 1), carried)
        mixed = jnp.swapaxes(mixed, 0, 1) + (between + jnp.swapaxes(carried, 0, 1)) * self.slopes
        angles = angles + self.slopes[:, None] * bends * self.slopes
        above = jnp.concatenate([lengths, mixed], axis=1)
        return jnp.concatenate([above, jnp.concatenate([jnp.swapaxes(mixed, 0, 1), angles], axis=1)])


def first_derivatives(
    density: Density, at: tuple[Float[Array, " F"], ...]
) -> tuple[Float[Array, " F"], Float[Array, "k F"]]:
    """The energy of every face and its derivatives in each of its arguments."""
    value, pull_back = jax.vjp(density, *at)
    return value, jnp.stack(pull_back(jnp.ones_like(value)))


def second_derivatives(density: Density, at: tuple[Float[Array, " F"], ...]) -> Float[Array, "k k F"]:
    """Second derivatives of the energy of every face in each pair of its arguments: one forward tangent each, the
    others symbolically zero."""
    slopes = lambda *arguments: jax.vjp(density, *arguments)[1](jnp.ones_like(at[0]))
    columns = []
    for i, number in enumerate(at):
        along = lambda x, i=i: slopes(*at[:i], x, *at[i + 1 :])
        columns.append(jnp.stack(jax.jvp(along, (number,), (jnp.ones_like(number),))[1]))
    return jnp.stack(columns)


def on_lengths(on_metric: Float[Array, "3 *k F"]) -> Float[Array, "3 *k F"]:
    """Derivatives in squared lengths from those in the components of the metric; see `metric_from_lengths`."""
    g11, g12, g22 = on_metric
    half = 0.5 * g12
    return jnp.stack([-half, half + g22, g11 + half])


def on_bends(on_curvature: Float[Array, "3 *k F"]) -> Float[Array, "3 *k F"]:
    """Derivatives in what each edge adds to the curvature from those in its components; see `curvature_from_bends`."""
    b11, b12, b22 = on_curvature
    return jnp.stack([b11 + b12 + b22, b11, b22])


def both_ways(linear: Callable[[Array], Array], matrix: Float[Array, "k k F"]) -> Float[Array, "k k F"]:
    """A symmetric matrix of every face, carried over on both sides."""
    return linear(jnp.swapaxes(linear(matrix), 0, 1))


def _sum(values: Float[Array, "3 F"]) -> Float[Array, " F"]:
    return values[0] + values[1] + values[2]


def _product(a: Float[Array, "3 3 F"], b: Float[Array, "3 3 F"]) -> Float[Array, "3 3 F"]:
    """Small matrices of every face multiplied: spelled out over the inner axis, elementwise over faces."""
    return a[:, 0, None] * b[0] + a[:, 1, None] * b[1] + a[:, 2, None] * b[2]
