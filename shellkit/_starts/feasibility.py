"""What a target asks of the material, found before anything is trained."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._geometry.forms import CurvatureForm
from .._geometry.surface import face_areas
from .._mesh.mesh import Mesh
from .layers import eigen, layer_metrics


class Feasibility(eqx.Module):
    """What a target asks of the two layers of a shell, face by face; printing it gives a summary."""

    top: Float[Array, "F 2"]
    """The stretches that the top layer needs along two axes, the larger first; NaN where there are none."""
    bottom: Float[Array, "F 2"]
    """Those of the bottom layer."""
    bend: Float[Array, " F"]
    """Thickness times the largest change of curvature. Below 3/2 some pair of layers can do it."""
    areas: Float[Array, " F"]
    """Of the mesh at rest, in its unit."""

    @property
    def possible(self) -> bool:
        """Whether some pair of layers makes the target exactly: `bend` is below 3/2 everywhere."""
        return bool(jnp.all(self.bend < 1.5))

    @property
    def range(self) -> tuple[float, float]:
        """The smallest and the largest stretch that any layer needs anywhere."""
        stretches = np.concatenate([self.top, self.bottom])
        return float(np.nanmin(stretches)), float(np.nanmax(stretches))

    def within(self, low: float, high: float) -> float:
        """The part of the area on which both layers need no stretch outside a range.

        **Arguments:**

        - `low`, `high`: the stretches of which the material is capable in any direction.
        """
        stretches = np.concatenate([self.top, self.bottom], axis=1)
        with np.errstate(invalid="ignore"):
            fine = np.all((stretches >= low) & (stretches <= high), axis=1)
        return _share(self.areas, fine)

    def nematic(self, stretch: float, area: float = 0.05) -> float:
        """The part of the area on which a nematic material can do what both layers need.

        **Arguments:**

        - `stretch`: the largest along the director, above one.
        - `area`: by what fraction the area may be missed, since a nematic layer keeps its own.
        """
        fine = np.ones(len(self.areas), bool)
        for layer in (np.asarray(self.top), np.asarray(self.bottom)):
            with np.errstate(invalid="ignore"):
                fine &= np.abs(layer[:, 0] * layer[:, 1] - 1) <= area
                fine &= np.sqrt(layer[:, 0] / layer[:, 1]) <= stretch
        return _share(self.areas, fine)

    def __str__(self) -> str:
        low, high = self.range
        sharp = int(np.count_nonzero(np.asarray(self.bend) >= 1.5))
        lines = [
            f"thickness × curvature   up to {float(jnp.max(self.bend)):.3g} (possible below 1.5)",
            f"stretches needed        {low:.3g} to {high:.3g}",
            f"growth within ±10 %     on {100 * self.within(0.9, 1.1):.0f} % of the area",
            f"nematic of stretch 1.1  on {100 * self.nematic(1.1):.0f} % of the area, to 5 % of area",
        ]
        if sharp:
            lines.append(f"impossible              on {sharp} of {len(self.areas)} faces: bent too sharply")
        return "\n".join(lines)


def _share(areas: Float[Array, " F"], chosen: np.ndarray) -> float:
    sizes = np.asarray(areas)
    return float(np.sum(sizes * chosen) / np.sum(sizes))


def feasibility(
    mesh: Mesh, target: Float[Array, "V 3"], thickness: float | Array, form: CurvatureForm = "sin"
) -> Feasibility:
    r"""What a target asks of a sheet of two equal layers, before anything is trained.

    The layers that make it exactly have the metrics $g \pm \tfrac{2h}{3}(b - b_0)$; here are their principal stretches
    from the mesh at rest. A target that asks for more than the material has can only be approached.

    **Arguments:**

    - `mesh`: the surface at rest.
    - `target`: where each vertex should go, shape `(V, 3)`. Its pose does not matter.
    - `thickness`: of the shell, one number or one per face, in the unit of the mesh.
    - `form`: how the energy's bending term measures curvature.

    **Returns:**

    The [`shellkit.Feasibility`][].

    **Raises:**

    `ValueError` if the target does not fit the mesh.

    ??? cite "Source"

        W. van Rees, E. Vouga and L. Mahadevan, "Growth patterns for shape-shifting elastic bilayers", PNAS 114 (2017),
        11597.
    """
    metrics = layer_metrics(mesh, target, thickness, form)
    stretches = [jnp.sqrt(eigen(metrics.rest, layer)[0]) for layer in (metrics.top, metrics.bottom)]
    return Feasibility(stretches[0], stretches[1], metrics.bend, face_areas(mesh.vertices, mesh))
