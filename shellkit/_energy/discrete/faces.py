"""Energy, gradient and Hessian of all terms of a sum that are functions of the fundamental forms of a face.

Each face has up to six intrinsic numbers, its squared edge lengths and half hinge angles. The terms are
differentiated by automatic differentiation, elementwise over all faces; the chain rule to these numbers, and from there
to positions, is written by hand.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree, Scalar

from ..._geometry.forms import (
    BEND_SLOPES,
    Components,
    CurvatureForm,
    curvature_from_bends,
    director_signs,
    metric_from_lengths,
)
from ..._geometry.patches import (
    SIGN,
    ClampedSide,
    HingeGradients,
    Hinges,
    Triangles,
    at_corners,
    hinge_curvature,
    length_curvature,
)
from ..._mesh.mesh import Mesh
from ..base import FormEnergy
from .convexity import FaceHessians
from .intrinsic import Bends, both_ways, first_derivatives, on_bends, on_lengths, second_derivatives
from .unknowns import Unknowns


class FaceState(eqx.Module):
    """The intrinsic numbers of all faces and the derivatives of their energies in these, where a step has taken them to
    first order: unknowns of their own, which agree with the positions once per relaxation has converged."""

    numbers: Float[Array, "k F"]
    stress: Float[Array, "k F"]


class FaceEnergies(eqx.Module):
    """The terms of one sum that share the kinematics of faces, with their data for one rest shape.

    Without `form` no term bends: the elements are single faces. Where directors are free each edge has an unknown,
    its angle times `director_length`; derivatives are in that. A `continuation` holds the normals of some edges.
    """

    terms: tuple[tuple[Array | None, FormEnergy, PyTree[Array]], ...]
    mesh: Mesh
    continuation: ClampedSide | None
    form: CurvatureForm | None = eqx.field(static=True)
    director_length: Scalar | None

    @property
    def folds(self) -> bool:
        """Whether a relaxation can end on a hinge that is folded flat: only an averaged normal vanishes there, and only
        a form that stays finite gets there."""
        return self.form not in (None, "tan") and self.director_length is None

    def _intrinsic(self, at: Unknowns) -> tuple[Triangles, Hinges | None, Float[Array, "k F"]]:
        triangles = Triangles(at.vertices, self.mesh)
        if self.form is None:
            return triangles, None, triangles.squared_lengths
        hinges = Hinges(at.vertices, self.mesh, triangles, self.continuation)
        half = hinges.near_part(hinges.angles)
        if self.director_length is not None:
            assert at.directors is not None
            half = half + director_signs(self.mesh) * at.directors[self.mesh.face_edges.T]
        return triangles, hinges, jnp.concatenate([triangles.squared_lengths, half])

    def _total(self, bending: bool, metric: Components, curvature: Components | None) -> Float[Array, " F"]:
        """The sum of the terms that bend, or of those that do not."""
        total = jnp.zeros_like(metric[0])
        for weight, term, data in self.terms:
            if (term.form is not None) == bending:
                density = term.density(metric, curvature, data)
                total = total + (density if weight is None else weight * density)
        return total

    def _flat(self, g11: Array, g12: Array, g22: Array) -> Float[Array, " F"]:
        """The terms that depend on the metric alone, as a function of its components."""
        return self._total(False, (g11, g12, g22), None)

    def _bent(self, g11: Array, g12: Array, g22: Array, b11: Array, b12: Array, b22: Array) -> Float[Array, " F"]:
        """The terms that bend, as a function of the components of metric and curvature."""
        return self._total(True, (g11, g12, g22), (b11, b12, b22))

    @property
    def _stretches(self) -> bool:
        return any(term.form is None for _, term, _ in self.terms)

    def _forms(self, numbers: Float[Array, "k F"]) -> tuple[Components, Bends | None]:
        """The metric of each face from its intrinsic numbers, and what its edges add to the curvature."""
        bends = None if self.form is None else Bends(numbers[:3], numbers[3:], self.form)
        return metric_from_lengths(numbers[:3]), bends

    def _value(self, numbers: Float[Array, "k F"]) -> Float[Array, " F"]:
        """The energy of each face as a function of its intrinsic numbers."""
        metric, bends = self._forms(numbers)
        value = self._flat(*metric) if self._stretches else jnp.zeros_like(numbers[0])
        return value if bends is None else value + self._bent(*metric, *curvature_from_bends(bends.values))

    def _value_and_stress(self, numbers: Float[Array, "k F"]) -> tuple[Float[Array, " F"], Float[Array, "k F"]]:
        """The energy of each face and its derivatives in the face's own intrinsic numbers."""
        metric, bends = self._forms(numbers)
        value, pull = jnp.zeros_like(numbers[0]), None
        if self._stretches:
            value, pull = first_derivatives(self._flat, metric)
        if bends is None:
            assert pull is not None  # there are no terms but these
            return value, on_lengths(pull)
        bent, both = first_derivatives(self._bent, (*metric, *curvature_from_bends(bends.values)))
        pull = both[:3] if pull is None else both[:3] + pull
        return value + bent, bends.stress(on_lengths(pull), on_bends(both[3:]))

    def _second_derivatives(
        self, numbers: Float[Array, "k F"]
    ) -> tuple[Float[Array, " F"], Float[Array, "k F"], Float[Array, "k k F"]]:
        """What `_value_and_stress` gives, and the second derivatives in the intrinsic numbers."""
        metric, bends = self._forms(numbers)
        value, pull, stretching = jnp.zeros_like(numbers[0]), None, None
        if self._stretches:
            value, pull = first_derivatives(self._flat, metric)
            stretching = second_derivatives(self._flat, metric)
        if bends is None:
            assert pull is not None and stretching is not None  # there are no terms but these
            return value, on_lengths(pull), both_ways(on_lengths, stretching)
        forms = (*metric, *curvature_from_bends(bends.values))
        bent, both = first_derivatives(self._bent, forms)
        hessian = second_derivatives(self._bent, forms)
        if pull is not None and stretching is not None:
            both = jnp.concatenate([both[:3] + pull, both[3:]])
            hessian = hessian + jnp.pad(stretching, ((0, 3), (0, 3), (0, 0)))
        pull = on_bends(both[3:])
        stress = bends.stress(on_lengths(both[:3]), pull)
        hessian = both_ways(lambda rows: jnp.concatenate([on_lengths(rows[:3]), on_bends(rows[3:])]), hessian)
        turns = BEND_SLOPES[bends.form](numbers[3:])[1]
        return value + bent, stress, bends.second(pull, hessian, turns)

    def energy(self, at: Unknowns) -> Scalar:
        """The sum over all faces."""
        return jnp.sum(self._value(self._intrinsic(at)[2]))

    def value_and_gradient(self, at: Unknowns) -> tuple[Scalar, Float[Array, "m F"]]:
        """The sum over all faces, and its derivatives in the m unknowns of each face, in the order of `unknowns`."""
        triangles, hinges, numbers = self._intrinsic(at)
        value, stress = self._value_and_stress(numbers)
        # Kept in memory, or XLA computes them again for every component.
        triangles, hinges, stress = jax.lax.optimization_barrier((triangles, hinges, stress))
        gradients = None if hinges is None else HingeGradients(triangles, hinges)
        return jnp.sum(value), self._pull_back(triangles, hinges, gradients, stress)

    def _pull_back(
        self, triangles: Triangles, hinges: Hinges | None, gradients: HingeGradients | None, stress: Float[Array, "k F"]
    ) -> Float[Array, "m F"]:
        """From derivatives in the intrinsic numbers to those in the unknowns."""
        pull = 2.0 * stress[:3, None] * triangles.edges
        if hinges is None or gradients is None:
            return jnp.concatenate(at_corners(-pull, pull))
        tails, heads, near, far = gradients.pull_back(hinges.near_part(stress[3:]))
        corners = at_corners(tails - pull, heads + pull)
        parts = [*(own + shared for own, shared in zip(near, corners, strict=True)), *far]
        if self.director_length is not None:
            parts.append(director_signs(self.mesh) / self.director_length * stress[3:])
        return jnp.concatenate(parts)

    def held_moments(self, at: Unknowns) -> Float[Array, "E 3"] | None:
        """The derivative of the energy as the surface beyond a held edge turns, as a vector along each edge; `None`
        where the normal of no edge is held."""
        triangles, hinges, numbers = self._intrinsic(at)
        if hinges is None or hinges.listed is None:
            return None
        # The half angle to a held normal is all of the angle, which grows as the arm turns about the face's edge.
        stress = self._value_and_stress(numbers)[1][3:]
        along = triangles.edges / jnp.sqrt(triangles.squared_lengths)[:, None]
        turns = jnp.where(hinges.listed, stress, 0.0)[:, None] * along
        return jnp.zeros((self.mesh.n_edges, 3)).at[self.mesh.face_edges.T].add(jnp.moveaxis(turns, 1, 2))

    def numbers(self, at: Unknowns) -> Float[Array, "k F"]:
        """The intrinsic numbers of all faces."""
        return self._intrinsic(at)[2]

    def derivatives(
        self,
        at: Unknowns,
        apart: FaceState | None = None,
        at_state: Bool[Array, ""] | bool = False,
    ) -> tuple[Scalar, Float[Array, "m F"], FaceHessians, Float[Array, "k F"], Float[Array, "k F"]]:
        """The sum over all faces, its gradient as in `value_and_gradient`, its second derivatives, the derivatives in
        the intrinsic numbers, and these.

        With `at_state`, the material is looked at where the state `apart` has it, to first order, and the geometric
        part has the stress of that state.
        """
        triangles, hinges, numbers = self._intrinsic(at)
        if apart is None:
            value, stress, intrinsic = self._second_derivatives(numbers)
            standing = stress
        else:
            there = jnp.where(at_state, apart.numbers, numbers)
            value, stress, intrinsic = self._second_derivatives(there)
            standing = jnp.where(at_state, apart.stress, stress)
            stress = stress + jnp.sum(intrinsic * (numbers - there), axis=1)
        # What several of the sums below use is kept in memory, or XLA computes it again for each.
        kept = (triangles, hinges, stress, standing, intrinsic)
        triangles, hinges, stress, standing, intrinsic = jax.lax.optimization_barrier(kept)
        corners = (2.0 * SIGN[:, :, None, None] * triangles.edges[:, None]).reshape(3, 9, -1)
        geometric, own = length_curvature(standing[:3]), None
        if hinges is not None:
            on_corners, on_far = HingeGradients(triangles, hinges).rows()
            share = hinges.near_part(jnp.ones_like(hinges.angles))
            corners = jnp.concatenate([corners, share[:, None] * on_corners])
            own = 0.5 * on_far
            if self.director_length is not None:
                signs = director_signs(self.mesh) / self.director_length
                own = jnp.concatenate([own, signs[:, None]], axis=1)
            hinge_stress = hinges.near_part(standing[3:])
            twins = jnp.maximum(self.mesh.twins.T, 0)
            beyond = hinge_stress.T.reshape(-1).at[twins].get(mode="promise_in_bounds", wrap_negative_indices=False)
            hinge_stress = hinges.hinged * hinge_stress + hinges.beyond * beyond
            geometric = geometric + hinge_curvature(triangles, hinge_stress)
        corners, own, geometric = jax.lax.optimization_barrier((corners, own, geometric))
        second = FaceHessians(corners, own, intrinsic, geometric)
        return jnp.sum(value), second.pull_back(stress), second, stress, numbers
