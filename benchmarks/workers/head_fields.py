"""Relaxations of one head from rest, at many director fields."""

import time
from collections.abc import Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax

import shellkit as sk

from .problems import bilayer, design_problem, director_angles


_STRETCH = 1.5


def measure(mesh: str, kind: str, form: str, count: int) -> dict:
    """How each relaxation ends, at `count` fields of a kind."""
    problem = design_problem(sk.Mesh.read(mesh), "sphericity", _STRETCH, "zero", form)
    jax.block_until_ready(problem())  # compiled
    return {"fields": [_relaxed(field) for field in _FIELDS[kind](problem, count)]}


def _relaxed(problem: sk.InverseProblem) -> dict:
    start = time.perf_counter()
    found = jax.block_until_ready(problem())
    return {
        "seconds": time.perf_counter() - start,
        "converged": bool(found.converged),
        "stable": bool(found.stable),
        "result": sk.RESULTS[found.result],
        "steps": int(found.steps),
        "factorisations": int(found.factorisations),
        "force_norm": float(found.gradient_norm),
    }


def _random(problem: sk.InverseProblem, count: int) -> Iterator[sk.InverseProblem]:
    generator = np.random.default_rng(0)
    for _ in range(count):
        angles = tuple(map(jnp.asarray, generator.uniform(0, np.pi, (2, problem.mesh.n_faces))))
        yield eqx.tree_at(director_angles, problem, angles)


def _along_training(problem: sk.InverseProblem, count: int) -> list[sk.InverseProblem]:
    """Those of every second step of a training run from all angles at zero."""
    met, steps = [], 2 * count
    keep = lambda step: met.append(step.problem) if step.step % 2 == 0 else None
    rate = optax.cosine_decay_schedule(0.15, steps, alpha=0.02)
    optimiser = optax.chain(optax.clip_by_global_norm(0.004), optax.adam(rate, b2=0.99))
    sk.fit(
        problem,
        optimiser,
        steps=steps,
        where=director_angles,
        callbacks=[keep],
        progress=False,
        warm_start=sk.WarmStart(),
        refuse=sk.Refuse(rise=0.1),
    )
    return met


def _orthogonal(problem: sk.InverseProblem, count: int) -> list[sk.InverseProblem]:
    along = sk.director_angles(problem.mesh, jnp.array([0.0, 0.0, 1.0]))
    crossed = bilayer(along, along + jnp.pi / 2, _STRETCH)
    return [eqx.tree_at(lambda p: p.actuation, problem, crossed)] * count


_FIELDS = {"random": _random, "training": _along_training, "orthogonal": _orthogonal}
