"""Elastic moduli: conversion from Young's modulus, what is refused, and the quadratic form that the isotropic StVK
energies share."""

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from .._geometry.forms import BEND, Components
from .._mesh.mesh import Mesh


def lame_halves(young: float | Array, poisson: float | Array) -> tuple[Array, Array]:
    """alpha = E nu / (2 (1 - nu^2)) and beta = E / (4 (1 + nu)): half the plane-stress Lamé pair."""
    if not isinstance(young, Tracer) and not isinstance(poisson, Tracer):
        young, poisson = np.asarray(young, dtype=float), np.asarray(poisson, dtype=float)  # nothing is compiled
    return jnp.asarray(young * poisson / (2 * (1 - poisson**2))), jnp.asarray(young / (4 * (1 + poisson)))


def check_modulus(term: str, name: str, value: Array, mesh: Mesh) -> None:
    """Refuse a modulus that is neither one number nor one a face, or not finite."""
    if value.shape not in ((), (mesh.n_faces,)):
        raise ValueError(
            f"{term}: {name} has shape {value.shape}; give one number or one a face, shape ({mesh.n_faces},)."
        )
    if not isinstance(value, Tracer) and not np.all(np.isfinite(value)):
        raise ValueError(f"{term}: {name} is not finite.")


def check_curvature_options(owner: str, form: str, directors: str) -> None:
    """Refuse a way of measuring curvature that there is not."""
    if form not in BEND:
        raise ValueError(f"{owner}: form is {form!r}; choose one of {', '.join(map(repr, BEND))}.")
    if directors not in ("average", "free"):
        raise ValueError(f"{owner}: directors is {directors!r}; choose 'average' or 'free'.")


def quadratic(inverse: Components, strain: Components, alpha: Array, beta: Array) -> Float[Array, " F"]:
    """alpha tr(M)^2 + 2 beta tr(M^2), with M = inverse metric times strain."""
    m11 = inverse[0] * strain[0] + inverse[1] * strain[1]
    m12 = inverse[0] * strain[1] + inverse[1] * strain[2]
    m21 = inverse[1] * strain[0] + inverse[2] * strain[1]
    m22 = inverse[1] * strain[1] + inverse[2] * strain[2]
    return alpha * (m11 + m22) ** 2 + 2 * beta * (m11 * m11 + 2 * m12 * m21 + m22 * m22)


def inverse(metric: Components, det: Array) -> Components:
    """The inverse of symmetric 2x2 forms."""
    return metric[2] / det, -metric[1] / det, metric[0] / det
