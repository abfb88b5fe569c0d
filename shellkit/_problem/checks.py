"""Whether the parts of a problem fit each other: what is refused before anything is traced."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax.core import Tracer
from jaxtyping import Array, Int

from .._actuation import Actuation
from .._energy import AbstractEnergy, Terms
from .._loss import Loss
from .._mesh.mesh import Mesh
from .._programs.tracing import is_traced
from .._solve.newton.newton import SparseNewton


def checked_thickness(thickness: float | Array, mesh: Mesh) -> Array:
    thickness = jnp.asarray(thickness, dtype=float)
    if thickness.shape not in ((), (mesh.n_faces,)):
        raise ValueError(
            f"InverseProblem: thickness has shape {thickness.shape}; give one number or one per face, "
            f"shape ({mesh.n_faces},)."
        )
    if not isinstance(thickness, Tracer):
        numbers = np.atleast_1d(np.asarray(thickness))
        bad = np.flatnonzero(~(np.isfinite(numbers) & (numbers > 0)))
        if len(bad):
            where = f" of face {bad[0]}" if numbers.size > 1 else ""
            raise ValueError(
                f"InverseProblem: the thickness{where} is {numbers[bad[0]]}; it must be positive and finite."
            )
    return thickness


def check_constraints(energy: AbstractEnergy, solver: optx.AbstractMinimiser) -> None:
    for weight, constraint in Terms.of(energy).constraints:
        name = type(constraint).__name__
        if not isinstance(solver, SparseNewton):
            raise ValueError(
                f"{name}: the multiplier of a constraint is found by SparseNewton only, not by {type(solver).__name__}."
            )
        if weight is not None:
            raise ValueError(f"{name}: a constraint has no weight; give it a stiffness, or leave the weight out.")


def check_loss(loss: Loss, mesh: Mesh, actuation: Actuation) -> None:
    """Refuse a mesh or an actuation that a loss cannot be evaluated on. What can only be told from values is not asked
    where they are traced."""
    try:
        loss.check(mesh, actuation)
    except (jax.errors.ConcretizationTypeError, jax.errors.TracerArrayConversionError):
        if not is_traced((loss, mesh, actuation)):
            raise


def check_one_curvature(energy: AbstractEnergy) -> None:
    """All bending terms of a sum measure one curvature: they share the rest shape and the edge normals."""
    kinds = {(term.form, term.directors) for term in Terms.of(energy).bending}
    if len(kinds) > 1:
        listed = "; ".join(f"form={form!r}, directors={directors!r}" for form, directors in sorted(kinds))
        raise ValueError(
            f"The bending terms of the energy measure curvature in different ways ({listed}); give all the same."
        )


def refuse_held_moments(energy: AbstractEnergy, held_edges: Sequence[Int[Array, " _"]], mesh: Mesh) -> None:
    """Refuse a moment on an edge whose normal is held: only the support would feel it.

    **Arguments:**

    - `energy`: of all terms.
    - `held_edges`: the edges whose normal is held, of each support.
    - `mesh`: the surface at rest.

    **Raises:** `ValueError` with the term and the edge.
    """
    for _, term in Terms.of(energy).elements:
        moments = term.director_moments(mesh)
        if moments is None:
            continue
        for edges in held_edges:
            loaded = np.flatnonzero(np.asarray(moments[edges]))
            if len(loaded):
                ends = np.asarray(mesh.edges)[np.asarray(edges)[loaded[0]]].tolist()
                raise ValueError(
                    f"{type(term).__name__}: the normal of the edge between the vertices {ends} is held by a support, "
                    "which alone would feel the moment; load another edge, or hold this one by Pinned."
                )
