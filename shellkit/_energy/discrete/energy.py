"""The energy of one scene at given parameters, as a function of its free unknowns: what a minimiser works on."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Scalar

from ..._geometry.patches import ClampedSide
from ..._mesh.mesh import Mesh
from ..._rest import RestShape
from ..._solve.linear.bordered import Bordered
from ..._solve.matrices.operator import SparseSymmetric
from ..base import AbstractEnergy, EnergyTerm
from ..terms import Terms
from .assembly import Assembly
from .constraint_set import Constraints
from .convexity import FaceHessians
from .elements import Elements
from .faces import FaceEnergies, FaceState
from .unknowns import Unknowns


class DiscreteEnergy(eqx.Module):
    """An energy bound to its mesh, rest shape and supports.

    Calling it gives the energy at the vector `y` of free unknowns; `gradient` and `hessian` are the derivatives in
    `y`, the latter sparse. All three can be differentiated in whatever the parts were made from.
    """

    assembly: Assembly
    faces: FaceEnergies | None
    elements: tuple[Elements, ...]
    constraints: Constraints | None  # what is held of the whole shell; None for nothing
    moments: Float[Array, " E"] | None  # on the edge normals, where directors are free; None for none
    prescribed: Float[Array, " N"]

    def __init__(
        self,
        energy: AbstractEnergy,
        mesh: Mesh,
        rest: RestShape,
        assembly: Assembly,
        prescribed: Float[Array, " N"],
        continuation: ClampedSide | None = None,
    ):
        """**Arguments:**

        - `energy`, `mesh`, `rest`: what is measured, where, and against what.
        - `assembly`: the numbering of this energy on this mesh.
        - `prescribed`: all unknowns; those that are not free keep these values.
        - `continuation`: how the surface goes on beyond edges whose normal is held.
        """
        terms, dofs = Terms.of(energy), assembly.dofs
        self.assembly = assembly
        self.faces = None
        if terms.faces:
            on_faces = tuple((weight, term, term.element_data(mesh, rest)) for weight, term in terms.faces)
            self.faces = FaceEnergies(on_faces, mesh, continuation, terms.form, dofs.director_length)
        n = len(terms.elements)
        self.elements = tuple(
            Elements(term, weight, term.element_data(mesh, rest), stencil)
            for (weight, term), stencil in zip(terms.elements, assembly.stencils[:n], strict=True)
        )
        constraints = [constraint for _, constraint in terms.constraints]
        self.constraints = Constraints.of(constraints, assembly.stencils[n:], mesh, rest)
        self.moments = _director_moments(terms.elements, mesh) if dofs.n_directors else None
        self.prescribed = prescribed

    def state(self, y: Float[Array, " n"]) -> Unknowns:
        """Positions and directors at the free unknowns `y`."""
        return self.assembly.dofs.unpack(self.assembly.dofs.extend(y, self.prescribed))

    def __call__(self, y: Float[Array, " n"]) -> Scalar:
        at = self.state(y)
        total = jnp.zeros(())
        if self.faces is not None:
            total = total + self.faces.energy(at)
        for elements in self.elements:
            total = total + elements.energy(at.vertices)
        if self.constraints is not None:
            total = total + self.constraints.energy(self.constraints.residuals(at.vertices))
        if self.moments is not None and at.directors is not None:
            total = total - self.moments @ at.directors
        return total

    def full_gradient(self, y: Float[Array, " n"]) -> Float[Array, " N"]:
        """The gradient in all unknowns; on the held ones it is the force by which their support acts on the shell."""
        return self._value_and_full_gradient(y)[1]

    def held_moments(self, y: Float[Array, " n"]) -> Float[Array, "E 3"] | None:
        """The couples by which supports act on the edges whose normal they hold; `None` where no normal is held."""
        return None if self.faces is None else self.faces.held_moments(self.state(y))

    def gradient(self, y: Float[Array, " n"]) -> Float[Array, " n"]:
        """The gradient in the free unknowns."""
        return self.assembly.dofs.restrict(self.full_gradient(y))

    def value_and_gradient(self, y: Float[Array, " n"]) -> tuple[Scalar, Float[Array, " n"]]:
        """The energy and its gradient in the free unknowns."""
        value, gradient = self._value_and_full_gradient(y)
        return value, self.assembly.dofs.restrict(gradient)

    def derivatives(
        self, y: Float[Array, " n"]
    ) -> tuple[Scalar, Float[Array, " n"], SparseSymmetric | Bordered, "Convexification"]:
        """The energy, its gradient and its Hessian in the free unknowns, which share most of the work.

        The Hessian is a [`Bordered`][] matrix where quantities of the whole shell are held. Last comes what makes it
        convex.
        """
        on_faces = None if self.faces is None else self.faces.derivatives(self.state(y))[:3]
        return self._added_up(y, on_faces)

    def faces_at(self, y: Float[Array, " n"]) -> FaceState:
        """The faces where the unknowns `y` have them, without stress."""
        assert self.faces is not None
        numbers = self.faces.numbers(self.state(y))
        return FaceState(numbers, jnp.zeros_like(numbers))

    def derivatives_apart(
        self, y: Float[Array, " n"], apart: FaceState, at_state: Bool[Array, ""]
    ) -> tuple[Scalar, Float[Array, " n"], SparseSymmetric | Bordered, "Convexification", "FacesAhead"]:
        """What `derivatives` returns, of the energy with the numbers of faces as unknowns of their own, reduced to `y`;
        and last where a step takes the faces.

        **Arguments:**

        - `y`: the free unknowns.
        - `apart`: the faces.
        - `at_state`: if not, they are taken where `y` has them, and all is as in `derivatives`.
        """
        assert self.faces is not None
        value, pulled, second, stress, numbers = self.faces.derivatives(self.state(y), apart, at_state)
        ahead = FacesAhead(self.assembly, numbers, stress, second)
        return *self._added_up(y, (value, pulled, second)), ahead

    def _added_up(
        self, y: Float[Array, " n"], on_faces: tuple[Scalar, Float[Array, "m F"], FaceHessians] | None
    ) -> tuple[Scalar, Float[Array, " n"], SparseSymmetric | Bordered, "Convexification"]:
        """The derivatives of all terms from those of the faces."""
        at = self.state(y)
        vertices = at.vertices
        total, pulled, second = (jnp.zeros(()), None, None) if on_faces is None else on_faces
        total, gradient = self._with_elements(total, pulled, at)
        on_elements = [elements.hessian(vertices) for elements in self.elements]
        constraints = self.constraints
        if constraints is not None:
            forces = constraints.forces(constraints.residuals(vertices))
            curvatures = [measure.hessian(vertices) for measure in constraints.measures]
            on_elements += [None if c is None else f * c for f, c in zip(forces, curvatures, strict=True)]
        hessian = self.assembly.matrix(second, tuple(on_elements))
        convexification = Convexification(self.assembly, second, tuple(on_elements))
        if constraints is not None:
            hessian = Bordered(hessian, self.constraint_jacobian(y), 1 / constraints.penalties, eliminated=True)
        return total, self.assembly.dofs.restrict(gradient), hessian, convexification

    def blank_hessian(self, y: Float[Array, " n"]) -> SparseSymmetric | Bordered:
        """A matrix of the structure of the Hessian in `derivatives`, of zeros."""
        blank = SparseSymmetric(self.assembly.pattern, jnp.zeros(self.assembly.pattern.nnz, y.dtype))
        if self.constraints is None:
            return blank
        m = len(self.constraints.targets)
        return Bordered(blank, jnp.zeros((m, len(y)), y.dtype), jnp.zeros(m, y.dtype), eliminated=True)

    def constraint_jacobian(self, y: Float[Array, " n"]) -> Float[Array, "m n"]:
        """The gradients, in the free unknowns, of the quantities that are held."""
        vertices = self.state(y).vertices
        measures = () if self.constraints is None else self.constraints.measures
        rows, absent = [], [None] * len(self.assembly.stencils)
        for k, measure in enumerate(measures):
            at = len(self.elements) + k
            parts = (*absent[:at], measure.value_and_gradient(vertices)[1], *absent[at + 1 :])
            rows.append(self.assembly.dofs.restrict(self.assembly.vector(None, parts)))
        return jnp.stack(rows)

    def constraint_residuals(self, y: Float[Array, " n"]) -> Float[Array, " m"]:
        """By how much the quantities that are held exceed their values."""
        assert self.constraints is not None
        return self.constraints.residuals(self.state(y).vertices)

    def with_multipliers(
        self, multipliers: Float[Array, " m"], penalties: Float[Array, " m"] | None = None
    ) -> "DiscreteEnergy":
        """This energy with the quantities that are held under other forces, without a penalty by default."""
        assert self.constraints is not None
        penalties = jnp.zeros_like(multipliers) if penalties is None else penalties
        return eqx.tree_at(lambda e: e.constraints, self, self.constraints.with_multipliers(multipliers, penalties))

    def hessian(self, y: Float[Array, " n"]) -> SparseSymmetric | Bordered:
        """The Hessian in the free unknowns."""
        return self.derivatives(y)[2]

    def _value_and_full_gradient(self, y: Float[Array, " n"]) -> tuple[Scalar, Float[Array, " N"]]:
        at = self.state(y)
        total, on_faces = jnp.zeros(()), None
        if self.faces is not None:
            total, on_faces = self.faces.value_and_gradient(at)
        return self._with_elements(total, on_faces, at)

    def _with_elements(
        self, total: Scalar, on_faces: Float[Array, "m F"] | None, at: Unknowns
    ) -> tuple[Scalar, Float[Array, " N"]]:
        """The energy and its gradient in all unknowns, from those of the faces."""
        vertices, gradients = at.vertices, []
        for elements in self.elements:
            value, gradient = elements.value_and_gradient(vertices)
            total = total + value
            gradients.append(gradient)
        if self.constraints is not None:
            measured = [measure.value_and_gradient(vertices) for measure in self.constraints.measures]
            residuals = jnp.stack([value for value, _ in measured]) - self.constraints.targets
            total = total + self.constraints.energy(residuals)
            forces = self.constraints.forces(residuals)
            gradients += [force * gradient for force, (_, gradient) in zip(forces, measured, strict=True)]
        if self.moments is not None and at.directors is not None:
            total = total - self.moments @ at.directors
        return total, self.assembly.vector(on_faces, tuple(gradients), self.moments)


class Convexification(eqx.Module):
    """What to add to a Hessian so that it is positive semidefinite: stress times the second derivatives of lengths and
    hinge angles is taken away, the energies of faces are made convex in these numbers, and those of other elements in
    the positions of their vertices.

    Worked out when it is called, as most Hessians need none.
    """

    assembly: Assembly
    faces: FaceHessians | None
    elements: tuple[Float[Array, "_ _ 3 _ 3"] | None, ...]

    def __call__(self) -> SparseSymmetric:
        return self.assembly.lift(self.faces, self.elements)


class FacesAhead(eqx.Module):
    """Where a step takes the numbers of the faces and their stress, to first order."""

    assembly: Assembly
    numbers: Float[Array, "k F"]
    stress: Float[Array, "k F"]
    second: FaceHessians

    def __call__(self, step: Float[Array, " n"]) -> FaceState:
        change = self.second.along(self.assembly.on_faces(step))
        return FaceState(self.numbers + change, self.stress + jnp.sum(self.second.intrinsic * change, axis=1))


def _director_moments(terms: tuple[tuple[Array | None, EnergyTerm], ...], mesh: Mesh) -> Float[Array, " E"] | None:
    total = None
    for weight, term in terms:
        moments = term.director_moments(mesh)
        if moments is not None:
            moments = moments if weight is None else weight * moments
            total = moments if total is None else total + moments
    return total
