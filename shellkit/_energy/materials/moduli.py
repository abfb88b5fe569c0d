"""Elastic moduli: conversion from Young's modulus, what is refused, and the quadratic form that the isotropic StVK
energies share."""

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from ..._geometry.forms import BEND, Components, determinant
from ..._mesh.mesh import Mesh
from ..._programs.tracing import known


def lame_halves(young: float | Array, poisson: float | Array) -> tuple[Array, Array]:
    """alpha = E nu / (2 (1 - nu^2)) and beta = E / (4 (1 + nu)): half the plane-stress Lamé pair."""
    if not isinstance(young, Tracer) and not isinstance(poisson, Tracer):
        e, nu = np.asarray(young, dtype=float), np.asarray(poisson, dtype=float)
        return known(e * nu / (2 * (1 - nu**2))), known(e / (4 * (1 + nu)))
    return jnp.asarray(young * poisson / (2 * (1 - poisson**2))), jnp.asarray(young / (4 * (1 + poisson)))


def check_modulus(term: str, name: str, value: Array, mesh: Mesh) -> None:
    """Refuse a modulus that is neither one number nor one per face, or not finite."""
    if value.shape not in ((), (mesh.n_faces,)):
        raise ValueError(
            f"{term}: {name} has shape {value.shape}; give one number or one per face, shape ({mesh.n_faces},)."
        )
    if not isinstance(value, Tracer) and not np.all(np.isfinite(value)):
        raise ValueError(f"{term}: {name} is not finite.")


def check_curvature_options(owner: str, form: str, directors: str) -> None:
    """Refuse a way of measuring curvature that there is not."""
    if form not in BEND:
        raise ValueError(f"{owner}: form is {form!r}; choose one of {', '.join(map(repr, BEND))}.")
    if directors not in ("average", "free"):
        raise ValueError(f"{owner}: directors is {directors!r}; choose 'average' or 'free'.")


def invariant_moduli(alpha: Array, beta: Array, det: Array) -> tuple[Array, Array]:
    """The factors of `quadratic`, for a metric of determinant `det`."""
    return alpha + 2 * beta, 4 * beta / det


def quadratic(inverse: Components, strain: Components, of_trace: Array, of_det: Array) -> Float[Array, " F"]:
    """alpha tr(M)^2 + 2 beta tr(M^2), with M = inverse metric times strain.

    By tr(M^2) = tr(M)^2 - 2 det(M), which takes a third of the operations.
    """
    trace = inverse[0] * strain[0] + 2 * inverse[1] * strain[1] + inverse[2] * strain[2]
    return of_trace * trace**2 - of_det * determinant(strain)


def inverse(metric: Components, det: Array) -> Components:
    """The inverse of symmetric 2x2 forms."""
    return metric[2] / det, -metric[1] / det, metric[0] / det
