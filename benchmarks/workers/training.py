"""A fit, with the relaxations that it takes counted one by one."""

import time
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optax

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
        problem = design_problem(mesh, "sphericity", 1.5, "zero", form="tan")
        return eqx.tree_at(lambda p: p.solver, problem, sk.SparseNewton(max_steps=40))
    target = teacher(mesh)().vertices
    blank = jnp.zeros(mesh.n_faces)
    return sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        energy=sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0),
        actuation=bilayer(blank, blank, 1.1),
        loss=sk.VertexDistance(target, aligner=sk.Kabsch()),
    )


def _optimiser(name: str, scene: str, steps: int) -> Any:
    def adam() -> optax.GradientTransformation:
        if scene != "suzanne":
            return optax.adam(0.1)
        # As in examples/suzanne.py, which says why.
        rate = optax.cosine_decay_schedule(0.15, steps, alpha=0.02)
        return optax.chain(optax.clip_by_global_norm(0.004), optax.adam(rate, b2=0.99))

    return {
        "adam": adam,
        "lbfgs": optax.lbfgs,
        "levenberg": lambda: sk.LevenbergMarquardt(rtol=1e-6, atol=1e-9),
    }[name]()


def measure(mesh: str, scene: str, optimiser: str, steps: int, limit_s: float) -> dict:
    """Relaxations, seconds and the loss at each step of a fit, after one that compiles what it needs. A step that ends
    beyond the limit is the last."""
    problem, method = _Counted(_problem(scene, sk.Mesh.read(mesh))), _optimiser(optimiser, scene, steps)
    options = {"where": lambda p: director_angles(p.inner), "progress": False}
    if scene == "suzanne":  # as in the example
        options["warm_start"] = sk.WarmStart(check_every=1000)
        options["refuse"] = sk.Refuse(rise=2.0 if optimiser == "levenberg" else None)
    start = time.perf_counter()
    sk.fit(problem, method, steps=2, **options)
    first_s = time.perf_counter() - start

    jax.effects_barrier()
    _COUNT[0] = 0
    trace, begun = [], time.perf_counter()

    def note(step: sk.FitStep) -> bool:
        jax.effects_barrier()
        seconds = time.perf_counter() - begun
        trace.append({"step": step.step, "relaxations": _COUNT[0], "seconds": seconds, "loss": step.loss})
        return seconds > limit_s

    result = sk.fit(problem, method, steps=steps, callbacks=[note], **options)
    return {"first_s": first_s, "trace": trace, "stopped": result.stopped, "best_loss": result.best_loss}
