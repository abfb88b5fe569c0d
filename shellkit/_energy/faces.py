"""Energy, gradient and Hessian of all terms of a sum that are functions of the fundamental forms of a face.

Each face has up to six intrinsic numbers, its squared edge lengths and half hinge angles. The terms are
differentiated in those by automatic differentiation, elementwise over all faces; the chain rule to positions is written
by hand.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree, Scalar

from .._geometry.forms import CurvatureForm, curvature_from_angles, director_signs, metric_from_lengths
from .._geometry.patches import (
    SIGN,
    Continuation,
    HingeGradients,
    Hinges,
    Triangles,
    at_corners,
    hinge_curvature,
    length_curvature,
)
from .._mesh.mesh import Mesh
from .base import FormEnergy
from .convexity import FaceHessians


class FaceState(eqx.Module):
    """The intrinsic numbers of all faces and the derivatives of their energies in these, where a step has taken them to
    first order: unknowns of their own, which agree with the positions once a relaxation has converged."""

    numbers: Float[Array, "k F"]
    stress: Float[Array, "k F"]


class FaceEnergies(eqx.Module):
    """The terms of one sum that share the kinematics of faces, with their data for one rest shape.

    Without `form` no term bends: the elements are single faces. Where directors are free each edge has an unknown,
    its angle times `director_length`; derivatives are in that. A `continuation` holds the normals of some edges.
    """

    terms: tuple[tuple[Array | None, FormEnergy, PyTree[Array]], ...]
    mesh: Mesh
    continuation: Continuation | None
    form: CurvatureForm | None = eqx.field(static=True)
    director_length: Scalar | None

    def _density(self, squared_lengths: Float[Array, "3 F"], half_angles: Float[Array, "3 F"] | None):
        metric = metric_from_lengths(squared_lengths)
        curvature = None
        if half_angles is not None and self.form is not None:
            # Heron's formula, sixteen times: the area as a function of the lengths, for the derivatives.
            twice_area = jnp.sqrt(metric[0] * metric[2] - metric[1] ** 2)
            curvature = curvature_from_angles(squared_lengths, twice_area, half_angles, self.form)
        total = jnp.zeros_like(squared_lengths[0])
        for weight, term, data in self.terms:
            density = term.density(metric, None if term.form is None else curvature, data)
            total = total + (density if weight is None else weight * density)
        return total

    def _intrinsic(self, vertices, directors):
        triangles = Triangles(vertices, self.mesh)
        if self.form is None:
            return triangles, None, tuple(triangles.squared_lengths)
        hinges = Hinges(vertices, self.mesh, triangles, self.continuation)
        half = hinges.near_part(hinges.angles)
        if self.director_length is not None:
            half = half + director_signs(self.mesh) * directors[self.mesh.face_edges.T]
        return triangles, hinges, (*triangles.squared_lengths, *half)

    def _of_numbers(self, *numbers: Float[Array, " F"]) -> Float[Array, " F"]:
        return self._density(jnp.stack(numbers[:3]), jnp.stack(numbers[3:]) if len(numbers) > 3 else None)

    def _value_and_stress(self, *numbers: Float[Array, " F"]) -> tuple[Float[Array, " F"], ...]:
        """The energy of each face and its derivatives in the face's own intrinsic numbers."""
        value, pull_back = jax.vjp(self._of_numbers, *numbers)
        return value, *pull_back(jnp.ones_like(value))

    def energy(self, vertices: Float[Array, "V 3"], directors: Float[Array, " E"] | None) -> Scalar:
        """The sum over all faces."""
        return jnp.sum(self._of_numbers(*self._intrinsic(vertices, directors)[2]))

    def value_and_gradient(
        self, vertices: Float[Array, "V 3"], directors: Float[Array, " E"] | None
    ) -> tuple[Scalar, Float[Array, "m F"]]:
        """The sum over all faces, and its derivatives in the m unknowns of each face, in the order of `unknowns`."""
        triangles, hinges, numbers = self._intrinsic(vertices, directors)
        value, *stress = self._value_and_stress(*numbers)
        # Kept in memory, or XLA computes them again for every component.
        triangles, hinges, stress = jax.lax.optimization_barrier((triangles, hinges, jnp.stack(stress)))
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

    def held_moments(
        self, vertices: Float[Array, "V 3"], directors: Float[Array, " E"] | None
    ) -> Float[Array, "E 3"] | None:
        """The derivative of the energy as the surface beyond a held edge turns, as a vector along each edge; `None`
        where the normal of no edge is held."""
        triangles, hinges, numbers = self._intrinsic(vertices, directors)
        if hinges is None or hinges.listed is None:
            return None
        # The half angle to a held normal is all of the angle, which grows as the arm turns about the face's edge.
        stress = jnp.stack(self._value_and_stress(*numbers)[4:])
        along = triangles.edges / jnp.sqrt(triangles.squared_lengths)[:, None]
        turns = jnp.where(hinges.listed, stress, 0.0)[:, None] * along
        return jnp.zeros((self.mesh.n_edges, 3)).at[self.mesh.face_edges.T].add(jnp.moveaxis(turns, 1, 2))

    def numbers(self, vertices: Float[Array, "V 3"], directors: Float[Array, " E"] | None) -> Float[Array, "k F"]:
        """The intrinsic numbers of all faces."""
        return jnp.stack(self._intrinsic(vertices, directors)[2])

    def derivatives(
        self,
        vertices: Float[Array, "V 3"],
        directors: Float[Array, " E"] | None,
        apart: FaceState | None = None,
        at_state: Bool[Array, ""] | bool = False,
    ) -> tuple[Scalar, Float[Array, "m F"], FaceHessians, Float[Array, "k F"]]:
        """The sum over all faces, its gradient as in `value_and_gradient`, its second derivatives, and the derivatives
        in the intrinsic numbers.

        With `at_state`, the material is looked at where the state `apart` has it, to first order, and the geometric
        part has the stress of that state.
        """
        triangles, hinges, numbers = self._intrinsic(vertices, directors)
        if apart is None:
            value, stress, intrinsic = _second_derivatives(self._value_and_stress, numbers)
            standing = stress
        else:
            there = [jnp.where(at_state, far, here) for far, here in zip(apart.numbers, numbers, strict=True)]
            value, stress, intrinsic = _second_derivatives(self._value_and_stress, tuple(there))
            standing = jnp.where(at_state, apart.stress, stress)
            stress = stress + jnp.sum(intrinsic * (jnp.stack(numbers) - jnp.stack(there)), axis=1)
        # What several of the sums below use is kept in memory, or XLA computes it again for each.
        kept = (triangles, hinges, stress, standing, intrinsic)
        triangles, hinges, stress, standing, intrinsic = jax.lax.optimization_barrier(kept)
        corners = [jnp.concatenate([2.0 * SIGN[i, p] * triangles.edges[i] for p in range(3)]) for i in range(3)]
        geometric = length_curvature(standing[:3])
        gradients = own = None
        if hinges is not None:
            gradients = HingeGradients(triangles, hinges)
            on_corners, on_far = gradients.rows()
            share = hinges.near_part(jnp.ones_like(hinges.angles))
            corners += [share[i] * jnp.concatenate(on_corners[i]) for i in range(3)]
            own = [0.5 * on_far[i] for i in range(3)]
            if self.director_length is not None:
                signs = director_signs(self.mesh) / self.director_length
                own = [jnp.concatenate([own[i], signs[i][None]]) for i in range(3)]
            own = jnp.stack(own)
            hinge_stress = hinges.near_part(standing[3:])
            beyond = hinge_stress.T.reshape(-1)[jnp.maximum(self.mesh.twins.T, 0)]
            hinge_stress = hinges.hinged * hinge_stress + hinges.beyond * beyond
            geometric = geometric + hinge_curvature(triangles, hinge_stress)
        pulled = self._pull_back(triangles, hinges, gradients, stress)
        return jnp.sum(value), pulled, FaceHessians(jnp.stack(corners), own, intrinsic, geometric), stress


def _second_derivatives(
    value_and_stress: Callable[..., tuple[Array, ...]], numbers: tuple[Array, ...]
) -> tuple[Float[Array, " F"], Float[Array, "k F"], Float[Array, "k k F"]]:
    """Value, first and second derivatives in the intrinsic numbers: one forward tangent each, the others symbolically
    zero."""
    columns = []
    for i, number in enumerate(numbers):
        along = lambda x, i=i: value_and_stress(*numbers[:i], x, *numbers[i + 1 :])
        (value, *stress), (_, *column) = jax.jvp(along, (number,), (jnp.ones_like(number),))
        columns.append(jnp.stack(column))
    return value, jnp.stack(stress), jnp.stack(columns)
