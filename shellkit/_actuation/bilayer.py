"""Two sheets glued together: their mean stretches the shell, and their difference bends it."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from .._citation.papers import VAN_REES_2017
from .._mesh.mesh import Mesh
from .._rest import RestShape
from .base import Actuation, SheetActuation


class Bilayer(Actuation):
    r"""Two sheets of equal thickness and stiffness, one on top of the other.

    $$g_r = \tfrac12 (g_t + g_b), \qquad b_r = b_0 + \frac{3}{4h} (g_t - g_b).$$

    The top is the side that the face normals point to: a top that grows bends the shell as a sphere seen from outside.

    **Arguments:**

    - `top`, `bottom`: the two sheets, each a [`shellkit.SheetActuation`][], of one kind or of two.

    **Raises:**

    `ValueError`, when a problem is built, for a layer that does more than change the metric of a sheet, or that does
    not fit the mesh.

    ??? cite "Source"

        W. van Rees, E. Vouga and L. Mahadevan, "Growth patterns for shape-shifting elastic bilayers", PNAS 114 (2017),
        11597.
    """

    papers: ClassVar[tuple[str, ...]] = (VAN_REES_2017,)
    top: SheetActuation
    bottom: SheetActuation

    def check(self, mesh: Mesh) -> None:
        for name, layer in (("top", self.top), ("bottom", self.bottom)):
            if not isinstance(layer, SheetActuation):
                raise ValueError(
                    f"Bilayer: {name} is a {type(layer).__name__}, which does more than change the metric of a sheet; "
                    "give a SheetActuation, such as Nematic or IsotropicGrowth."
                )
            layer.check(mesh)

    def on(self, mesh: Mesh) -> "Bilayer":
        return Bilayer(self.top.on(mesh), self.bottom.on(mesh))

    def director_fields(self) -> tuple[Float[Array, " F"], ...]:
        return self.top.director_fields() + self.bottom.director_fields()

    def __call__(self, rest: RestShape) -> RestShape:
        top, bottom = self.top.actuated_metric(rest.metric), self.bottom.actuated_metric(rest.metric)
        curvature = rest.curvature
        if curvature is not None:
            curvature = curvature + 0.75 / rest.thickness[:, None, None] * (top - bottom)
        return RestShape(0.5 * (top + bottom), curvature, rest.thickness)

    def at(self, progress: float | Float[Array, ""]) -> "Bilayer":
        """Both layers, each gone through by a fraction."""
        return eqx.tree_at(
            lambda both: (both.top, both.bottom), self, (self.top.at(progress), self.bottom.at(progress))
        )
