"""Contact with rigid bodies, by a penalty: a plane and a sphere that push away what comes too near."""

from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float, Int, Scalar

from ..._citation.papers import WRIGGERS_2006
from ..._geometry.surface import vertex_areas
from ..._mesh.mesh import Mesh
from ..._rest import RestShape
from ..base import EnergyTerm


_FAR = 1e3  # times the size of the scene: a distance at which everything is in contact


class Cushion(eqx.Module):
    """How a rigid body pushes: from `distance` on, softly for a depth `softness`, then as a spring."""

    stiffness: Float[Array, ""]
    softness: Float[Array, ""]
    distance: Float[Array, ""]

    def __init__(self, stiffness, softness, distance):
        self.stiffness = jnp.asarray(stiffness, dtype=float)
        self.softness = jnp.asarray(softness, dtype=float)
        self.distance = jnp.asarray(distance, dtype=float)

    def energy(self, gap: Scalar, area: Scalar) -> Scalar:
        """Of a piece of surface at a distance `gap`; its second derivative is continuous."""
        depth = jnp.maximum(self.distance - gap, 0.0)
        within = jnp.minimum(depth, self.softness)
        beyond = depth - within
        cubic = within**3 / (6 * self.softness)
        return self.stiffness * area * (cubic + 0.5 * beyond * (self.softness + beyond))

    def check(self, owner: str) -> None:
        """Refuse what does not push."""
        for name, value in (("stiffness", self.stiffness), ("softness", self.softness), ("distance", self.distance)):
            if value.shape != ():
                raise ValueError(f"{owner}: {name} has shape {value.shape}; give one number.")
            if not isinstance(value, Tracer) and not (np.isfinite(value) and (value > 0 or name == "distance")):
                raise ValueError(f"{owner}: {name} is {float(value)}; it must be finite and positive.")


class PlaneContact(EnergyTerm):
    r"""A rigid plane that the surface lies upon, without friction.

    With the depth $d = \max(0, d_0 - (x - p)\cdot n)$ of a vertex below the distance $d_0$ from the plane, and the area
    $A$ of the vertex at rest, it costs

    $$k A\, \frac{d^3}{6 \delta} \quad (d \le \delta), \qquad k A \left(\frac{d^2}{2} - \frac{d \delta}{2} +
    \frac{\delta^2}{6}\right) \quad (d \ge \delta).$$

    Its force and stiffness are continuous, so Newton's method sees no kink. A penalty, not a barrier: the surface sinks
    in until the force balances, by a pressure over $k$ and half of $\delta$. Vertices are checked, faces are not:
    nothing is seen of a corner of the body between vertices.

    Without contact nothing holds a free shell in place. It then needs a load that brings it there, or supports.

    ??? cite "Source"

        P. Wriggers, "Computational contact mechanics" (2nd edition, 2006), chapter 5, with the kink rounded off.
    """

    papers: ClassVar[tuple[str, ...]] = (WRIGGERS_2006,)
    point: Float[Array, " 3"]
    normal: Float[Array, " 3"]
    cushion: Cushion

    def __init__(
        self,
        point: ArrayLike | Sequence,
        normal: ArrayLike | Sequence,
        stiffness: float | Array,
        softness: float | Array,
        distance: float | Array = 0.0,
    ):
        r"""**Arguments:**

        - `point`, `normal`: of the plane; the normal, of any length, points to the side where the surface may be.
        - `stiffness`: $k$, pressure per depth.
        - `softness`: $\delta$, the depth over which the stiffness builds up; about what may be sunk in.
        - `distance`: $d_0$, at which contact begins, such as half the thickness.
        """
        self.point = jnp.asarray(point, dtype=float)
        self.normal = jnp.asarray(normal, dtype=float)
        self.cushion = Cushion(stiffness, softness, distance)

    def check(self, mesh: Mesh) -> None:
        _check_vector("PlaneContact", "point", self.point)
        _check_vector("PlaneContact", "normal", self.normal)
        if not isinstance(self.normal, Tracer) and not np.any(self.normal):
            raise ValueError("PlaneContact: the normal is zero; give the direction away from the plane.")
        self.cushion.check("PlaneContact")

    def stencil(self, mesh: Mesh) -> Int[Array, "V 1"]:
        return jnp.arange(mesh.n_vertices)[:, None]

    def element_data(self, mesh: Mesh, rest: RestShape):
        return vertex_areas(mesh.vertices, mesh)

    def element_energy(self, x: Float[Array, "1 3"], data) -> Scalar:
        normal = self.normal / jnp.sqrt(jnp.sum(self.normal**2))
        return self.cushion.energy(jnp.sum((x[0] - self.point) * normal), data)

    def engaged(self) -> "PlaneContact":
        """This plane, as it acts on what lies deep below it: then it resists the same motions."""
        return eqx.tree_at(lambda c: c.cushion.distance, self, _FAR * (1 + jnp.abs(self.cushion.distance)))


class SphereContact(EnergyTerm):
    r"""A rigid sphere that keeps the surface outside, or inside, without friction.

    As [`shellkit.PlaneContact`][], with the distance $|x - c| - R$ from the sphere, or $R - |x - c|$ with
    `inside=True`, for a shell in a spherical mould. The centre of the sphere is no place for a vertex.

    ??? cite "Source"

        P. Wriggers, "Computational contact mechanics" (2nd edition, 2006), chapter 5, with the kink rounded off.
    """

    papers: ClassVar[tuple[str, ...]] = (WRIGGERS_2006,)
    centre: Float[Array, " 3"]
    radius: Float[Array, ""]
    cushion: Cushion
    inside: bool = eqx.field(static=True)

    def __init__(
        self,
        centre: ArrayLike | Sequence,
        radius: float | Array,
        stiffness: float | Array,
        softness: float | Array,
        distance: float | Array = 0.0,
        inside: bool = False,
    ):
        r"""**Arguments:**

        - `centre`, `radius`: of the sphere.
        - `stiffness`: $k$, pressure per depth.
        - `softness`: $\delta$, the depth over which the stiffness builds up; about what may be sunk in.
        - `distance`: $d_0$, at which contact begins, such as half the thickness.
        - `inside`: whether the surface is to stay inside.
        """
        self.centre = jnp.asarray(centre, dtype=float)
        self.radius = jnp.asarray(radius, dtype=float)
        self.cushion = Cushion(stiffness, softness, distance)
        self.inside = inside

    def check(self, mesh: Mesh) -> None:
        _check_vector("SphereContact", "centre", self.centre)
        if self.radius.shape != () or (not isinstance(self.radius, Tracer) and not self.radius > 0):
            raise ValueError(f"SphereContact: radius is {self.radius}; give one positive number.")
        self.cushion.check("SphereContact")

    def stencil(self, mesh: Mesh) -> Int[Array, "V 1"]:
        return jnp.arange(mesh.n_vertices)[:, None]

    def element_data(self, mesh: Mesh, rest: RestShape):
        return vertex_areas(mesh.vertices, mesh)

    def element_energy(self, x: Float[Array, "1 3"], data) -> Scalar:
        squared = jnp.sum((x[0] - self.centre) ** 2)
        distance = jnp.where(squared > 0, jnp.sqrt(jnp.where(squared > 0, squared, 1.0)), 0.0) - self.radius
        return self.cushion.energy(-distance if self.inside else distance, data)

    def engaged(self) -> "SphereContact":
        """This sphere, as it acts on what is deep in it: then it resists the same motions."""
        return eqx.tree_at(lambda c: c.cushion.distance, self, _FAR * (1 + jnp.abs(self.cushion.distance)))


def _check_vector(owner: str, name: str, value: Array) -> None:
    if value.shape != (3,):
        raise ValueError(f"{owner}: {name} has shape {value.shape}; give a vector, shape (3,).")
    if not isinstance(value, Tracer) and not np.all(np.isfinite(value)):
        raise ValueError(f"{owner}: {name} is not finite.")
