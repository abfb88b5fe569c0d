"""What a relaxation returns: the shape, and everything about how it was found."""

import dataclasses
import os
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int, Scalar

from ._energy import Unknowns
from ._fields.shape import face_fields, material_fields, vertex_fields
from ._mesh.files import write as write_mesh
from ._mesh.formats.content import Content
from ._mesh.mesh import Mesh
from ._programs.tracing import with_parts
from ._rest import RestShape


class RESULTS(optx.RESULTS):  # pyright: ignore[reportGeneralTypeIssues]  # an Equinox enumeration: made to be extended
    """How a relaxation ended; `RESULTS[equilibrium.result]` is the message."""

    hinge_folded = (
        "The relaxation ended on a hinge that is folded flat, where the averaged edge normal vanishes and the energy "
        "has no gradient: there is no equilibrium to find. Equilibrium.worst_hinge is the edge. Use "
        'Bending(form="tan"), which resists folding, or a weaker actuation.'
    )
    hinge_pressed = (
        "The relaxation stopped short of an equilibrium with a hinge that is folded flat; Equilibrium.worst_hinge is "
        "the edge. Relax along a path, allow more steps, or take a weaker actuation or load, or a finer mesh there."
    )
    stuck = (
        "No step lowers the energy, far from an equilibrium. Common causes: a face of nearly no area, an energy that "
        "is not finite or has no gradient there. Look at equilibrium.vertices, or relax along a path."
    )


class Pose(eqx.Module):
    """The parts of an equilibrium that have a derivative; see [`shellkit.Equilibrium`][]."""

    unknowns: Unknowns
    reactions: Float[Array, "V 3"] | None = None
    moments: Float[Array, "E 3"] | None = None
    multipliers: Float[Array, " m"] | None = None


class Diagnostics(eqx.Module):
    """How an equilibrium was found; see [`shellkit.Equilibrium`][]."""

    energy: Scalar
    gradient_norm: Scalar
    steps: Int[Array, ""]
    factorisations: Int[Array, ""]
    converged: Bool[Array, ""]
    stable: Bool[Array, ""]
    result: RESULTS | optx.RESULTS
    worst_hinge: Int[Array, ""] | None = None

    @classmethod
    def of_nothing(cls) -> "Diagnostics":
        """Those of a shape to which nothing was done."""
        zero, none, yes = (jnp.asarray(number) for number in (0.0, np.int32(0), True))
        return cls(zero, zero, none, none, yes, yes, RESULTS.successful)


class Equilibrium(eqx.Module):
    """A shape at which the energy is stationary, or as near as the relaxation came.

    `vertices` (and `directors`, the angles by which edge normals are turned, where the energy has them, and
    `reactions`, `moments` and `multipliers`, where something is held) are differentiable in all arrays of the problem;
    the diagnostics are not.
    """

    mesh: Mesh
    """The surface at rest."""
    rest: RestShape
    """The rest shape under actuation."""
    vertices: Float[Array, "V 3"]
    """Positions at equilibrium, in the unit of the mesh."""
    directors: Float[Array, " E"] | None
    """Angles by which edge normals are turned, in radians; `None` unless directors are free."""
    reactions: Float[Array, "V 3"] | None
    """Forces by which supports act on the shell, in units of pressure times area; `None` where nothing is held. They
    balance the loads."""
    moments: Float[Array, "E 3"] | None
    """Couples by which supports act on the edges whose normal they hold, along each such edge, in units of force times
    length; `None` where no normal is held. With the moments of the reactions they balance those of the loads."""
    multipliers: Float[Array, " m"] | None
    """Of each constraint of the energy, in the order of its terms: the pressure of a [`shellkit.VolumeConstraint`][],
    minus the tension of an [`shellkit.AreaConstraint`][]; `None` where there is none."""
    energy: Scalar
    """In units of pressure times volume."""
    gradient_norm: Scalar
    """Euclidean norm of the gradient of the energy in all free unknowns."""
    steps: Int[Array, ""]
    """Steps of the minimiser."""
    factorisations: Int[Array, ""]
    """Factorisations of the Hessian."""
    converged: Bool[Array, ""]
    """Whether the minimiser reached its tolerance."""
    stable: Bool[Array, ""]
    """Whether the Hessian there has no negative eigenvalue: a minimum, not a saddle."""
    result: RESULTS | optx.RESULTS
    """How the relaxation ended; see [`shellkit.RESULTS`][]."""
    worst_hinge: Int[Array, ""] | None
    """The edge with the largest hinge angle; `None` where nothing bends."""

    @classmethod
    def of(cls, mesh: Mesh, rest: RestShape, pose: Pose, found: Diagnostics) -> "Equilibrium":
        """An equilibrium from its parts: the surface at rest, the rest shape, what has a derivative, and the rest."""
        parts = (pose.unknowns, pose, found)
        values = {field.name: getattr(part, field.name) for part in parts for field in dataclasses.fields(part)}
        del values["unknowns"]
        return cls(mesh=mesh, rest=rest, **values)

    @property
    def unknowns(self) -> Unknowns:
        """Positions and directors together."""
        return Unknowns(self.vertices, self.directors)

    def with_unknowns(self, unknowns: Unknowns) -> "Equilibrium":
        """The same with other positions and directors, as where to start a relaxation from."""
        return with_parts(self, vertices=unknowns.vertices, directors=unknowns.directors)

    @property
    def diagnostics(self) -> Diagnostics:
        """How it was found."""
        return Diagnostics(**{field.name: getattr(self, field.name) for field in dataclasses.fields(Diagnostics)})

    def write(self, path: str | os.PathLike, *, problem: Any = None) -> None:
        """Writes the relaxed shape with its fields to a file, whole or not at all: for ParaView and others.

        On vertices: `displacement` from rest, and `reaction` where something is held. On faces: `thickness` at rest;
        `strain`, the elastic one against the actuated rest shape, a symmetric tensor in space, and `principal_strains`,
        its larger and smaller value. With the problem also `stress`, that of [`shellkit.membrane_stress`][] as a
        tensor in space, and `von_mises`; `energy_density`; and `director` (of several layers `top_director`,
        `bottom_director`, ...), unit vectors carried along with the material.

        **Arguments:**

        - `path`: where to; the extension tells the format, as for [`shellkit.Mesh.write`][]. vtu, vtp and vtk keep all
            fields, ply and msh some, obj, off and stl only the shape.
        - `problem`: the [`shellkit.InverseProblem`][] that this is an equilibrium of, for its material and directors.

        **Raises:** `MeshFileError` for an unknown format or a missing folder; `ValueError` for a problem on another
        mesh.
        """
        faces = face_fields(self.mesh, self.rest, self.vertices)
        if problem is not None:
            faces |= material_fields(problem, self.mesh, self.rest, self.vertices, self.directors)
        on_vertices = vertex_fields(self.mesh, self.vertices, self.reactions)
        content = Content(np.asarray(self.vertices), np.asarray(self.mesh.faces), on_vertices, faces)
        write_mesh(path, content, silent=True)
