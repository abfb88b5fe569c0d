"""Card 12: Taylor's test of the loss in every array that can be trained."""

import time
from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np

import shellkit as sk

from ..figures import Figure


TITLE = "Gradients"
PROBLEM = (
    "The remainder of a first-order expansion of the loss along a random direction, over four halvings of the step: "
    "its slope is 2 exactly if the gradient is right. The adjoint against the tangent."
)
WHERE = {
    "angles": lambda p: (p.actuation.top.angle, p.actuation.bottom.angle),
    "stretch": lambda p: (p.actuation.top.stretch, p.actuation.bottom.stretch),
    "thickness": lambda p: p.thickness,
    "moduli": lambda p: (
        p.energy.terms[0].bulk,
        p.energy.terms[0].shear,
        p.energy.terms[1].alpha,
        p.energy.terms[1].beta,
    ),
    "rest vertices": lambda p: p.mesh.vertices,
    "target": lambda p: p.loss.target,
}


def closed(subdivisions: int, directors: str) -> sk.InverseProblem:
    """A bilayer of random directors on a sphere, every array of which is a field over its faces."""
    mesh = sk.meshes.icosphere(subdivisions)
    random = np.random.default_rng(1)
    field = lambda: sk.Nematic(jnp.asarray(random.normal(size=mesh.n_faces)), stretch=jnp.full(mesh.n_faces, 1.1))
    return sk.InverseProblem(
        mesh=mesh,
        thickness=jnp.full(mesh.n_faces, 0.1),
        actuation=sk.Bilayer(top=field(), bottom=field()),
        energy=sk.NeoHookean(8.0 * jnp.ones(mesh.n_faces), 4.0)
        + sk.Bending(jnp.ones(mesh.n_faces), 0.7, directors=directors, form="tan"),
        loss=sk.VertexDistance(mesh.vertices * jnp.array([0.95, 0.95, 1.2]), aligner=sk.Kabsch()),
    )


def measure(level: int, directors=("free",), names=tuple(WHERE)) -> Iterator[Figure]:
    """Each array; the slope is the least of four halvings."""
    for kind in directors:
        problem = closed(1 if level < 3 else 2, kind)
        for name in names:
            started = time.perf_counter()
            report = sk.taylor_test(problem, where=WHERE[name])
            seconds = time.perf_counter() - started  # compilation included: a test runs once
            yield Figure("least slope of the remainder", name, 0, 2.0, float(np.min(report.slopes)), seconds)
            yield Figure("gradient against differences", name, 0, 0.0, float(report.error), seconds)
            yield Figure("adjoint against tangent", name, 0, 0.0, float(report.tangent_error), seconds)
