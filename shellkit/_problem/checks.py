"""Whether the parts of a problem fit each other: what is refused before anything is traced."""

import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax.core import Tracer
from jaxtyping import Array

from .._energy import AbstractEnergy, Constraint, FormEnergy
from .._mesh.mesh import Mesh
from .._solve.newton.newton import SparseNewton


def checked_thickness(thickness: float | Array, mesh: Mesh) -> Array:
    thickness = jnp.asarray(thickness, dtype=float)
    if thickness.shape not in ((), (mesh.n_faces,)):
        raise ValueError(
            f"InverseProblem: thickness has shape {thickness.shape}; give one number or one a face, "
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
    for weight, term in energy.weighted_terms():
        if not isinstance(term, Constraint):
            continue
        name = type(term).__name__
        if not isinstance(solver, SparseNewton):
            raise ValueError(
                f"{name}: the multiplier of a constraint is found by SparseNewton only, not by {type(solver).__name__}."
            )
        if weight is not None:
            raise ValueError(f"{name}: a constraint has no weight; give it a stiffness, or leave the weight out.")


def check_one_curvature(energy: AbstractEnergy) -> None:
    """All bending terms of a sum measure one curvature: they share the rest shape and the edge normals."""
    bending = [term for _, term in energy.weighted_terms() if isinstance(term, FormEnergy) and term.form is not None]
    kinds = {(term.form, term.directors) for term in bending}
    if len(kinds) > 1:
        listed = "; ".join(f"form={form!r}, directors={directors!r}" for form, directors in sorted(kinds))
        raise ValueError(
            f"The bending terms of the energy measure curvature in different ways ({listed}); give all the same."
        )
