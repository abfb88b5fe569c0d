"""What an energy is: a sum of weighted terms, each of which names its elements and the energy of one."""

import abc
from collections.abc import Iterator
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PyTree, Scalar

from .._geometry.forms import Components, CurvatureForm
from .._mesh.mesh import Mesh
from .._rest import RestShape


class AbstractEnergy(eqx.Module):
    """Anything that adds to the energy of a shell; energies add and scale: `a + 2.0 * b`."""

    papers: ClassVar[tuple[str, ...]] = ()
    """What to cite for it, as BibTeX; see [`shellkit.InverseProblem.citation`][]."""

    @abc.abstractmethod
    def weighted_terms(self) -> Iterator[tuple[Array | None, "EnergyTerm | FormEnergy"]]:
        """The single terms of this energy, each with its weight (`None` for one)."""

    @abc.abstractmethod
    def at(self, progress: float | Scalar) -> "AbstractEnergy":
        """This energy with a fraction `progress`, from 0 to 1, of its loads."""

    @abc.abstractmethod
    def on(self, mesh: Mesh) -> "AbstractEnergy":
        """This energy with the vertices that it names spelled out as indices, which a problem stores and `jit` can pass
        on."""

    def __add__(self, other: "AbstractEnergy") -> "SumOfEnergies":
        if not isinstance(other, AbstractEnergy):
            return NotImplemented
        left = self.terms if isinstance(self, SumOfEnergies) else (self,)
        right = other.terms if isinstance(other, SumOfEnergies) else (other,)
        return SumOfEnergies(left + right)

    def __mul__(self, weight: float | Scalar) -> "ScaledEnergy":
        return ScaledEnergy(self, jnp.asarray(weight, dtype=float))

    __rmul__ = __mul__


class SumOfEnergies(AbstractEnergy):
    """A sum of energies; `terms` holds them in the order in which they were added."""

    terms: tuple[AbstractEnergy, ...]

    def at(self, progress: float | Scalar) -> "SumOfEnergies":
        return SumOfEnergies(tuple(term.at(progress) for term in self.terms))

    def on(self, mesh: Mesh) -> "SumOfEnergies":
        return SumOfEnergies(tuple(term.on(mesh) for term in self.terms))

    def weighted_terms(self):
        for term in self.terms:
            yield from term.weighted_terms()


class ScaledEnergy(AbstractEnergy):
    """An energy times a weight, which is an array like any other and can be trained."""

    term: AbstractEnergy
    weight: Scalar

    def at(self, progress: float | Scalar) -> "ScaledEnergy":
        return ScaledEnergy(self.term.at(progress), self.weight)

    def on(self, mesh: Mesh) -> "ScaledEnergy":
        return ScaledEnergy(self.term.on(mesh), self.weight)

    def weighted_terms(self):
        for weight, term in self.term.weighted_terms():
            yield self.weight if weight is None else self.weight * weight, term


class EnergyTerm(AbstractEnergy):
    """A sum of equal elements, each an energy of a few vertices. Subclass it to write an energy of your own.

    Name the vertices of each element and write the energy of one; the gradient, the sparse Hessian and the
    derivatives for the adjoint are made from it by automatic differentiation. Where the energy is a function of the
    two fundamental forms of a face, subclass [`shellkit.FormEnergy`][] instead: its derivatives are an order faster.

    ??? example

        ```python
        class EdgeSprings(sk.EnergyTerm):
            stiffness: Array

            def stencil(self, mesh):
                return mesh.edges

            def element_data(self, mesh, rest):
                a, b = mesh.vertices[mesh.edges[:, 0]], mesh.vertices[mesh.edges[:, 1]]
                return jnp.linalg.norm(a - b, axis=-1)

            def element_energy(self, x, rest_length):
                return 0.5 * self.stiffness * (jnp.linalg.norm(x[0] - x[1]) - rest_length) ** 2
        ```
    """

    linear: ClassVar[bool] = False
    """Whether the energy is linear in the positions: then it has no part in the Hessian, and takes no room there."""

    @abc.abstractmethod
    def stencil(self, mesh: Mesh) -> Int[Array, "N k"]:
        """The vertices of each element, as indices; called once, when a problem is built."""

    def element_data(self, mesh: Mesh, rest: RestShape) -> PyTree[Array]:
        """Data of the elements, arrays with a leading axis N, passed on to `element_energy`; called once a
        relaxation."""
        return None

    @abc.abstractmethod
    def element_energy(self, x: Float[Array, "k 3"], data: PyTree[Array]) -> Scalar:
        """The energy of one element at vertex positions `x`, with its slice of the data."""

    def director_moments(self, mesh: Mesh) -> Float[Array, " E"] | None:
        """Moments on the edge normals about their edges, where directors are free: for loads that turn the normal of an
        edge itself; `None`, as for most, for none."""
        return None

    def longest_step(self, start: Float[Array, "V 3"], step: Float[Array, "V 3"]) -> Scalar | None:
        """The largest part of a step of all vertices that may be taken, for terms that must not be stepped over, such
        as a barrier; anything from 1 on is all of it. `None`, as for most, for any step. A step that is too long is
        halved until it is not."""
        return None

    def engaged(self) -> "EnergyTerm":
        """This term where it acts: itself, unless it acts in a part of space only, as contact does. Asked which rigid
        motions it resists."""
        return self

    def check(self, mesh: Mesh) -> None:
        """Raise a `ValueError` if this term does not fit the mesh; called when a problem is built."""

    def at(self, progress: float | Scalar) -> "AbstractEnergy":
        """This term with a fraction of its load: itself, unless it is one."""
        return self

    def on(self, mesh: Mesh) -> "AbstractEnergy":
        """This term with the vertices that it names spelled out as indices: itself, unless it names some."""
        return self

    def weighted_terms(self):
        yield None, self


class FormEnergy(AbstractEnergy):
    """An energy of each face that is a function of its two fundamental forms: override only `density`.

    The kinematics, the forms with their first and second derivatives, are the library's own and written by hand; all
    such terms of a sum share them. `form` is how the term measures curvature (see [`shellkit.second_form`][]), or
    `None` if it depends on the metric alone: a sum of such terms couples the three vertices of a face and no others.
    With `directors="free"` each edge carries one more unknown, the angle by which its normal is turned.
    """

    form: eqx.AbstractVar[CurvatureForm | None]
    directors: eqx.AbstractVar[str]

    @abc.abstractmethod
    def element_data(self, mesh: Mesh, rest: RestShape) -> PyTree[Array]:
        """Data of the faces, arrays with a trailing axis F, passed on to `density`; called once per relaxation."""

    @abc.abstractmethod
    def density(self, metric: Components, curvature: Components | None, data: PyTree[Array]) -> Float[Array, " F"]:
        """The energy of every face. Forms come as their components 11, 12 and 22, arrays of shape `(F,)`.

        Write it with elementwise operations only: they are differentiated and fused over all faces at once.
        """

    def check(self, mesh: Mesh) -> None:
        """Raise a `ValueError` if this term does not fit the mesh; called when a problem is built."""

    def at(self, progress: float | Scalar) -> "AbstractEnergy":
        """This term with a fraction of its load: itself, unless it is one."""
        return self

    def on(self, mesh: Mesh) -> "AbstractEnergy":
        """This term with the vertices that it names spelled out as indices: itself, unless it names some."""
        return self

    def weighted_terms(self):
        yield None, self
