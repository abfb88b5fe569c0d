"""A fit, with the relaxations that it takes counted one by one."""

import time
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
import optimistix as optx

import shellkit as sk

from ..scene import THICKNESS
from .problems import bilayer, design_problem, director_angles, teacher


_COUNT = [0]


def _count() -> None:
    _COUNT[0] += 1


class _Counted(eqx.Module):
    """A problem that counts its relaxations as they run, those of line searches included."""

    inner: sk.InverseProblem

    def objective(self, start: Any = None):
        jax.debug.callback(_count)
        return self.inner.objective(start)

    def residuals(self, equilibrium: Any):
        return self.inner.residuals(equilibrium)


def _problem(scene: str, mesh: sk.Mesh) -> sk.InverseProblem:
    if scene == "ellipsoid":
        return design_problem(mesh, "ellipsoid", 1.1, "zero")
    if scene == "suzanne":
        return design_problem(mesh, "sphericity", 1.5, "zero")
    target = teacher(mesh)().vertices
    blank = jnp.zeros(mesh.n_faces)
    return sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        energy=sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0),
        actuation=bilayer(blank, blank, 1.1),
        loss=sk.VertexDistance(target, aligner=sk.Kabsch()),
    )


def _optimiser(name: str, scene: str) -> Any:
    falling = optax.piecewise_interpolate_schedule("linear", 0.5, {25: 0.2, 50: 0.2})
    return {
        "adam": lambda: optax.adam(falling if scene == "suzanne" else 0.1),
        "lbfgs": optax.lbfgs,
        "levenberg": lambda: optx.LevenbergMarquardt(rtol=1e-6, atol=1e-9),
    }[name]()


def measure(mesh: str, scene: str, optimiser: str, steps: int, limit_s: float) -> dict:
    """Relaxations, seconds and the loss at each step of a fit, after one that compiles what it needs."""
    problem, method = _Counted(_problem(scene, sk.Mesh.read(mesh))), _optimiser(optimiser, scene)
    options = {"where": lambda p: director_angles(p.inner), "progress": False}
    start = time.perf_counter()
    sk.fit(problem, method, steps=2, **options)
    first_s = time.perf_counter() - start

    jax.effects_barrier()
    _COUNT[0] = 0
    trace = []

    def note(step: sk.FitStep) -> None:
        jax.effects_barrier()
        seconds = float(step.history["seconds"][-1])
        trace.append({"step": step.step, "relaxations": _COUNT[0], "seconds": seconds, "loss": step.loss})

    result = sk.fit(problem, method, steps=steps, max_seconds=limit_s, callbacks=[note], **options)
    return {"first_s": first_s, "trace": trace, "stopped": result.stopped, "best_loss": result.best_loss}
