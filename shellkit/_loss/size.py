"""Losses on how large the relaxed surface is: its area and the volume it encloses."""

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float, Scalar

from .._actuation.base import Actuation
from .._equilibrium import Equilibrium
from .._geometry.surface import enclosed_volume, surface_area
from .._mesh.mesh import Mesh
from .base import LeastSquaresLoss


class Area(LeastSquaresLoss):
    """Squared relative error of the relaxed surface's area, $(A / A^* - 1)^2$.

    **Arguments:**

    - `target`: the area wanted, $A^*$, in the square of the vertices' unit.

    **Returns:**

    When called, a scalar without unit.

    **Raises:**

    `ValueError` unless the target is one positive number.
    """

    target: Float[Array, ""]

    def __init__(self, target: ArrayLike):
        self.target = _checked_size("Area", target)

    def residuals(self, equilibrium: Equilibrium, actuation: Actuation) -> Float[Array, " m"]:
        return _relative_error(surface_area(equilibrium.vertices, equilibrium.mesh), self.target)

    @property
    def sees_motion(self) -> bool:
        return False


class Volume(LeastSquaresLoss):
    """Squared relative error of the volume inside the relaxed surface, $(V / V^* - 1)^2$. For closed surfaces only.

    **Arguments:**

    - `target`: the volume wanted, $V^*$, in the cube of the vertices' unit.

    **Returns:**

    When called, a scalar without unit.

    **Raises:**

    `ValueError` unless the target is one positive number; when checked, for a mesh with a boundary.
    """

    target: Float[Array, ""]

    def __init__(self, target: ArrayLike):
        self.target = _checked_size("Volume", target)

    def residuals(self, equilibrium: Equilibrium, actuation: Actuation) -> Float[Array, " m"]:
        return _relative_error(enclosed_volume(equilibrium.vertices, equilibrium.mesh), self.target)

    def check(self, mesh: Mesh, actuation: Actuation) -> None:
        if not mesh.is_closed:
            raise ValueError("Volume: the mesh has a boundary and encloses no volume; use a closed mesh, or Area.")

    @property
    def sees_motion(self) -> bool:
        return False


def _relative_error(found: Scalar, target: Scalar) -> Float[Array, " 1"]:
    return jnp.reshape(found / target - 1, (1,))


def _checked_size(name: str, target: ArrayLike) -> Float[Array, ""]:
    target = jnp.asarray(target, dtype=float)
    if target.shape != ():
        raise ValueError(f"{name}: target has shape {target.shape}; give one number, shape ().")
    if not isinstance(target, Tracer):
        value = float(np.asarray(target))
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name}: target is {value}; it must be finite and positive.")
    return target
