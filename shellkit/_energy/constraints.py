"""Constraints of the whole shell that are held: its volume, its area. What holds one is a force: its multiplier."""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Scalar

from .._citation.papers import NOCEDAL_2006
from .._geometry.rowwise import length
from .._mesh.mesh import Mesh
from .._programs.tracing import known
from .._supports.selection import Numbers
from .base import AbstractEnergy, EnergyTerm
from .loads.followers import Pressure


class Constraint(AbstractEnergy):
    r"""A quantity $s$ of the whole shell that is held at a value $s_0$; subclass it to write one of your own.

    Name the quantity, as a sum over elements, and its value. It is held exactly, by a multiplier $p$ that the
    relaxation finds with the shape, and that [`shellkit.Equilibrium`][] reports in `multipliers`: at equilibrium the
    forces are those of the energy $-p\,s$. With a `stiffness` $k$ it is held by a spring instead, of energy
    $\tfrac12 k (s - s_0)^2$, and $p = -k (s - s_0)$. Both cost one more right-hand side a step: the dense matrix of a
    quantity that all vertices share is never made. Along a path its value goes from that at rest to the one wanted.

    The solver has to be [`shellkit.SparseNewton`][].

    ??? example

        ```python
        class Height(sk.EnergyTerm):
            def stencil(self, mesh):
                return jnp.arange(mesh.n_vertices)[:, None]

            def element_energy(self, x, data):
                return x[0, 2]


        class TotalHeight(sk.Constraint):
            value: Array
            stiffness: Array | None = None
            progress: float = 1.0

            def measure(self):
                return Height()

            def target(self, at_rest):
                return at_rest + self.progress * (self.value - at_rest)
        ```

    ??? cite "Source"

        The multiplier is found as in J. Nocedal and S. Wright, "Numerical Optimization", 2nd edition (2006), section
        17.3 (augmented Lagrangian), with Newton steps in place of its first-order update.
    """

    papers: ClassVar[tuple[str, ...]] = (NOCEDAL_2006,)

    stiffness: eqx.AbstractVar[Float[Array, ""] | None]
    """Of the spring; `None` where the value is held exactly."""
    progress: eqx.AbstractVar[float | Scalar]
    """How much of the way from the value at rest has been gone, from 0 to 1."""

    @abc.abstractmethod
    def measure(self) -> EnergyTerm:
        """The quantity that is held, written as an energy would be."""

    @abc.abstractmethod
    def target(self, at_rest: Scalar) -> Scalar:
        """The value to hold it at; `at_rest` is that of the surface at rest."""

    def at(self, progress: float | Scalar) -> "AbstractEnergy":
        """This constraint, with its value on the way from that at rest by a fraction `progress`."""
        return eqx.tree_at(lambda s: s.progress, self, jnp.asarray(progress, dtype=float))

    def on(self, mesh: Mesh) -> "AbstractEnergy":
        """This constraint with the vertices that it names spelled out as indices: itself, unless it names some."""
        return self

    def check(self, mesh: Mesh) -> None:
        """Raise a `ValueError` if this constraint does not fit the mesh; called when a problem is built."""
        check_number(type(self).__name__, "stiffness", self.stiffness, positive=True)

    def weighted_terms(self):
        yield None, self


class VolumeConstraint(Constraint):
    """The volume inside a shell is held, as by water in it; or, with a `stiffness`, by a fluid that can be compressed.

    Its multiplier is the pressure inside over that outside, positive where the shell is blown up. An open surface is
    closed by the cone from its boundary to a point, as by [`shellkit.Pressure`][], with the same provisos.

    ??? cite "Source"

        As of [`shellkit.Constraint`][]: J. Nocedal and S. Wright, "Numerical Optimization", 2nd edition (2006).
    """

    volume: Float[Array, ""] | None
    apex: Float[Array, " 3"] | None
    stiffness: Float[Array, ""] | None
    progress: float | Scalar

    def __init__(self, volume: Numbers | None = None, apex: Numbers | None = None, stiffness: Numbers | None = None):
        """**Arguments:**

        - `volume`: to hold, in the cube of the mesh's unit; by default that at rest.
        - `apex`: of the cone that closes an open surface; by default the mean of the boundary's vertices at rest.
        - `stiffness`: rise of pressure per volume pressed out; by default none may be.
        """
        self.volume = None if volume is None else jnp.asarray(volume, dtype=float)
        self.apex = None if apex is None else jnp.asarray(apex, dtype=float)
        self.stiffness = None if stiffness is None else jnp.asarray(stiffness, dtype=float)
        self.progress = known(np.float64(1.0))

    def measure(self) -> EnergyTerm:
        return Pressure(-1.0, self.apex)

    def target(self, at_rest: Scalar) -> Scalar:
        return at_rest if self.volume is None else at_rest + self.progress * (self.volume - at_rest)

    def check(self, mesh: Mesh) -> None:
        check_number("VolumeConstraint", "volume", self.volume)
        check_number("VolumeConstraint", "stiffness", self.stiffness, positive=True)


class AreaConstraint(Constraint):
    """The area of the surface is held, as by a skin that flows in its plane but does not stretch: a vesicle, a soap
    film that has lost its soap.

    Its multiplier is minus the tension, a force per length: positive where the skin is compressed.

    ??? cite "Source"

        As of [`shellkit.Constraint`][]: J. Nocedal and S. Wright, "Numerical Optimization", 2nd edition (2006).
    """

    area: Float[Array, ""] | None
    stiffness: Float[Array, ""] | None
    progress: float | Scalar

    def __init__(self, area: Numbers | None = None, stiffness: Numbers | None = None):
        """**Arguments:**

        - `area`: to hold, in the square of the mesh's unit; by default that at rest.
        - `stiffness`: rise of tension per area drawn out; by default none may be.
        """
        self.area = None if area is None else jnp.asarray(area, dtype=float)
        self.stiffness = None if stiffness is None else jnp.asarray(stiffness, dtype=float)
        self.progress = known(np.float64(1.0))

    def measure(self) -> EnergyTerm:
        return _Area()

    def target(self, at_rest: Scalar) -> Scalar:
        return at_rest if self.area is None else at_rest + self.progress * (self.area - at_rest)

    def check(self, mesh: Mesh) -> None:
        check_number("AreaConstraint", "area", self.area, positive=True)
        check_number("AreaConstraint", "stiffness", self.stiffness, positive=True)


class Inflation(Constraint):
    """A closed shell is filled until it holds so many times its volume at rest, as a balloon is by a pump.

    The pressure that this takes is its multiplier, which may well fall while the balloon grows: a given volume is
    stable where a given pressure is not. Along a path the volume rises evenly.

    ??? cite "Source"

        As of [`shellkit.Constraint`][]: J. Nocedal and S. Wright, "Numerical Optimization", 2nd edition (2006).
    """

    factor: Float[Array, ""]
    stiffness: Float[Array, ""] | None
    progress: float | Scalar

    def __init__(self, factor: Numbers):
        """**Arguments:**

        - `factor`: the volume over that at rest.
        """
        self.factor = jnp.asarray(factor, dtype=float)
        self.stiffness = None
        self.progress = known(np.float64(1.0))

    def check(self, mesh: Mesh) -> None:
        check_number("Inflation", "factor", self.factor, positive=True)
        if not mesh.is_closed:
            raise ValueError(
                "Inflation: the surface is open; give a VolumeConstraint, which says how its opening is closed."
            )
        if not isinstance(mesh.vertices, Tracer) and _signed_volume(mesh) <= 0:
            raise ValueError("Inflation: the normals point inwards; turn the faces, mesh.faces[:, ::-1].")

    def measure(self) -> EnergyTerm:
        return Pressure(-1.0)

    def target(self, at_rest: Scalar) -> Scalar:
        return (1 + self.progress * (self.factor - 1)) * at_rest


def _signed_volume(mesh: Mesh) -> float:
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    return float(np.linalg.det(corners - corners.mean(axis=(0, 1))).sum())


class _Area(EnergyTerm):
    """The area of the surface, as an energy."""

    def stencil(self, mesh: Mesh):
        return mesh.faces

    def element_energy(self, x: Float[Array, "3 3"], data) -> Scalar:
        return 0.5 * length(jnp.cross(x[1] - x[0], x[2] - x[0]))


def check_number(owner: str, name: str, value: Array | None, positive: bool = False) -> None:
    """Refuse what is not one finite number."""
    if value is None or isinstance(value, Tracer):
        return
    if value.shape != () or not np.isfinite(value) or (positive and value <= 0):
        kind = "positive" if positive else "finite"
        raise ValueError(f"{owner}: {name} is {value}; give one {kind} number.")
