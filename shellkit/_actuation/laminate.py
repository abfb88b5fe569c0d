"""Any number of sheets glued together, of any thickness and stiffness each: what a shell of them would like to become,
and how stiff it is."""

from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._citation.papers import TIMOSHENKO_1925, VAN_REES_2017
from .._mesh.mesh import Mesh
from .._rest import RestShape
from .base import Actuation, Passive, SheetActuation, check_per_face


class Layer(eqx.Module):
    """One sheet of a [`shellkit.Laminate`][]: what it would like to become, how thick and how stiff it is."""

    sheet: SheetActuation
    thickness: Float[Array, "..."]
    stiffness: Float[Array, "..."]

    def __init__(
        self, sheet: SheetActuation | None = None, thickness: float | Array = 1.0, stiffness: float | Array = 1.0
    ):
        """**Arguments:**

        - `sheet`: what changes its metric, such as [`shellkit.Nematic`][]; by default nothing.
        - `thickness`: relative to the other layers, whose sum is the thickness of the shell. One number or one per
            face.
        - `stiffness`: how many times as stiff it is as the material of the energy. One number or one per face. All
            layers have the energy's Poisson ratio.
        """
        self.sheet = Passive() if sheet is None else sheet
        self.thickness = jnp.asarray(thickness, dtype=float)
        self.stiffness = jnp.asarray(stiffness, dtype=float)


class Laminate(Actuation):
    r"""Layers of different thickness and stiffness glued together.

    With the height $z$ counted from the neutral surface, where $\sum_i s_i \int_i z\,\mathrm dz = 0$, layer $i$ of
    stiffness $s_i$ and metric $g_i$ would like to have the metric $g_i + 2 z b_0$ there, and has $g + 2 z b$. The
    integral through the thickness of $\tfrac14 s_i (\alpha\,\mathrm{tr}^2 + 2\beta\,\mathrm{tr}\,(\cdot)^2)$ of the
    difference is a sum of squares about

    $$g_r = \frac{\sum_i s_i h_i g_i}{\sum_i s_i h_i}, \qquad b_r = b_0 + \frac{\sum_i s_i \int_i z\,\mathrm dz\; g_i}
    {2 \sum_i s_i \int_i z^2\,\mathrm dz},$$

    and a constant, which is left out. Stretching is $\sum s_i h_i / h$ times and bending $12 \sum s_i \int_i z^2 / h^3$
    times as stiff as of the energy's own material; the terms of the energy see to that.

    The mesh is the neutral surface, the mid-surface of a symmetric shell. Strains are measured in $g_r$ for all layers,
    exact to the order of the strain between them; that apart, nothing is assumed of how thick or stiff the layers are.
    Two equal layers are a [`shellkit.Bilayer`][]. Two unequal isotropic ones bend as Timoshenko's bimetal strip.
    Layers with a grain, or different Poisson ratios, need [`shellkit.LaminateEnergy`][].

    ??? cite "Sources"

        W. van Rees, E. Vouga and L. Mahadevan, "Growth patterns for shape-shifting elastic bilayers", PNAS 114 (2017),
        11597: two equal layers. S. Timoshenko, "Analysis of bi-metal thermostats", J. Opt. Soc. Am. 11 (1925), 233.
    """

    papers: ClassVar[tuple[str, ...]] = (
        VAN_REES_2017,
        TIMOSHENKO_1925,
    )
    layers: tuple[Layer, ...]

    def __init__(self, layers: Sequence[Layer]):
        """**Arguments:**

        - `layers`: from the bottom to the top, the side that the face normals point to.

        **Raises:** `ValueError`, when a problem is built, without layers, for one that does more than change the metric
        of a sheet, or for a thickness or stiffness that does not fit the mesh or is not positive.
        """
        self.layers = tuple(layers)

    def check(self, mesh: Mesh) -> None:
        if not self.layers:
            raise ValueError("Laminate: there are no layers; give at least one.")
        for number, layer in enumerate(self.layers):
            owner = f"Laminate: layer {number}"
            if not isinstance(layer, Layer):
                raise ValueError(f"{owner} is a {type(layer).__name__}; wrap it, as in sk.Layer(sheet, thickness=0.2).")
            if not isinstance(layer.sheet, SheetActuation):
                raise ValueError(
                    f"{owner} holds a {type(layer.sheet).__name__}, which does more than change the metric of a sheet; "
                    "give a SheetActuation, such as Nematic or IsotropicGrowth."
                )
            check_per_face(owner, "thickness", layer.thickness, mesh, scalar=True, positive=True)
            check_per_face(owner, "stiffness", layer.stiffness, mesh, scalar=True, positive=True)
            layer.sheet.check(mesh)

    def on(self, mesh: Mesh) -> "Laminate":
        sheets = lambda laminate: [layer.sheet for layer in laminate.layers]
        return eqx.tree_at(sheets, self, [sheet.on(mesh) for sheet in sheets(self)])

    def director_fields(self) -> tuple[Float[Array, " F"], ...]:
        return tuple(field for layer in self.layers for field in layer.sheet.director_fields())

    def __call__(self, rest: RestShape) -> RestShape:
        metrics = [layer.sheet.actuated_metric(rest.metric) for layer in self.layers]
        zeroth, first, second = self._moments(rest.thickness)
        total = sum(zeroth)
        metric = jnp.zeros_like(rest.metric)
        for weight, layer in zip(zeroth, metrics, strict=True):
            metric = metric + _times(weight / total, layer)
        curvature = rest.curvature
        if curvature is not None:
            for moment, layer in zip(first, metrics, strict=True):
                # The first moments add up to zero: against the rest metric no digits are lost.
                curvature = curvature + _times(moment / (2 * sum(second)), layer - rest.metric)
        h = rest.thickness
        return RestShape(metric, curvature, h, total / h, 12 * sum(second) / h**3)

    def _moments(self, thickness: Float[Array, " F"]) -> tuple[list[Array], list[Array], list[Array]]:
        """The integrals of stiffness, times 1, z and z², over each layer, with z from the neutral surface."""
        relative = [jnp.broadcast_to(layer.thickness, thickness.shape) for layer in self.layers]
        heights = [thickness * part / sum(relative) for part in relative]
        middles, below = [], jnp.zeros_like(thickness)
        for height in heights:
            middles.append(below + 0.5 * height)
            below = below + height
        zeroth = [layer.stiffness * height for layer, height in zip(self.layers, heights, strict=True)]
        neutral = sum(weight * middle for weight, middle in zip(zeroth, middles, strict=True)) / sum(zeroth)
        middles = [middle - neutral for middle in middles]
        first = [weight * middle for weight, middle in zip(zeroth, middles, strict=True)]
        second = [
            weight * (middle**2 + height**2 / 12)
            for weight, middle, height in zip(zeroth, middles, heights, strict=True)
        ]
        return zeroth, first, second

    def at(self, progress: float | Float[Array, ""]) -> "Laminate":
        """All layers, each gone through by a fraction."""
        sheets = lambda laminate: [layer.sheet for layer in laminate.layers]
        return eqx.tree_at(sheets, self, [sheet.at(progress) for sheet in sheets(self)])


def _times(weight: Float[Array, " F"], form: Float[Array, "F 2 2"]) -> Float[Array, "F 2 2"]:
    return weight[:, None, None] * form
