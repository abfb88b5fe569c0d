"""Training: the loss against relaxations and against seconds, for Adam, L-BFGS and Levenberg–Marquardt."""

import itertools
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optax

import shellkit as sk

from .. import tables
from ..case import Case, Row
from ..problems import bilayer, design_problem, director_angles, teacher


class Scene(NamedTuple):
    """What is trained on a mesh."""

    mesh: str
    name: str
    steps: dict[str, int]


_OPTIMISERS = {"adam": "Adam", "lbfgs": "L-BFGS", "levenberg": "Levenberg–Marquardt"}
SCENES = {
    "teacher": Scene("icosphere-1", "Teacher, 42 vertices", {"adam": 200, "lbfgs": 60, "levenberg": 30}),
    "ellipsoid": Scene("icosphere-3", "Ellipsoid, 642 vertices", {"adam": 100, "lbfgs": 40, "levenberg": 20}),
    "suzanne": Scene("suzanne", "Suzanne to a sphere, 1400 vertices", {"adam": 200, "lbfgs": 100, "levenberg": 60}),
}
_PARTS = (0.5, 0.9, 1.0)


def cases(quick: bool) -> list[Case]:
    found = []
    # The head is no head on a sphere.
    for (name, scene), optimiser in itertools.product(list(SCENES.items())[: 2 if quick else 3], _OPTIMISERS):
        steps, limit_s = (5, 20.0) if quick else (scene.steps[optimiser], 180.0)
        arguments = {"mesh": "icosphere-1" if quick else scene.mesh, "scene": name, "optimiser": optimiser}
        arguments |= {"steps": steps, "limit_s": limit_s}
        found.append(Case(f"{name} {optimiser}", "questions.training", arguments))
    return found


class _Counted(eqx.Module):
    """A problem that counts its relaxations as they run, those of line searches included."""

    inner: sk.InverseProblem
    count: Callable[[], None] = eqx.field(static=True)

    def objective(self, start: Any = None):
        jax.debug.callback(self.count)
        return self.inner.objective(start)

    def residuals(self, equilibrium: Any):
        return self.inner.residuals(equilibrium)


def _problem(scene: str, mesh: sk.Mesh) -> sk.InverseProblem:
    if scene == "ellipsoid":
        return design_problem(mesh, "ellipsoid", 1.1, "zero")
    if scene == "suzanne":
        return design_problem(mesh, "sphericity", 1.5, "zero", form="tan", solver=sk.SparseNewton(max_steps=40))
    problem, blank = teacher(mesh), jnp.zeros(mesh.n_faces)
    loss = sk.VertexDistance(problem().vertices, aligner=sk.Kabsch())
    return eqx.tree_at(lambda p: p.actuation, teacher(mesh, loss), bilayer(blank, blank, 1.1))


def _optimiser(name: str, scene: str, steps: int) -> Any:
    if name == "levenberg":
        return sk.LevenbergMarquardt(rtol=1e-6, atol=1e-9)
    if name == "lbfgs":
        return optax.lbfgs()
    if scene != "suzanne":
        return optax.adam(0.1)
    # As in examples/suzanne.py, which says why.
    rate = optax.cosine_decay_schedule(0.15, steps, alpha=0.02)
    return optax.chain(optax.clip_by_global_norm(0.004), optax.adam(rate, b2=0.99))


def measure(mesh: str, scene: str, optimiser: str, steps: int, limit_s: float) -> dict:
    """Relaxations, seconds and the loss at each step of a fit, after one that compiles what it needs. A step that ends
    beyond the limit is the last."""
    done = []  # an entry for each relaxation
    problem = _Counted(_problem(scene, sk.Mesh.read(mesh)), lambda: done.append(None))
    method = _optimiser(optimiser, scene, steps)
    options = {"where": lambda p: director_angles(p.inner), "progress": False}
    if scene == "suzanne":  # as in the example
        options["warm_start"] = sk.WarmStart(check_every=1000)
        options["refuse"] = sk.Refuse(rise=2.0 if optimiser == "levenberg" else None)
    start = time.perf_counter()
    sk.fit(problem, method, steps=2, **options)
    first_s = time.perf_counter() - start

    jax.effects_barrier()
    done.clear()
    trace, begun = [], time.perf_counter()

    def note(step: sk.FitStep) -> bool:
        jax.effects_barrier()
        seconds = time.perf_counter() - begun
        trace.append({"step": step.step, "relaxations": len(done), "seconds": seconds, "loss": step.loss})
        return seconds > limit_s

    result = sk.fit(problem, method, steps=steps, callbacks=[note], **options)
    return {"first_s": first_s, "trace": trace, "stopped": result.stopped, "best_loss": result.best_loss}


def page(rows: list[Row]) -> str:
    return tables.sections({key: scene.name for key, scene in SCENES.items()}, rows, "scene", _table)


def _table(rows: list[Row]) -> str:
    levels = [f"{100 * part:.0f} % of Adam's descent" for part in _PARTS]
    head = ("", *levels, "loss at the end", "steps", "relaxations", "time", "compilation and first step")
    adam = next((row for row in rows if row["case"]["optimiser"] == "adam" and not tables.missing(row)), None)

    def cells(row: Row) -> list[str]:
        trace = row["trace"]
        reached = ["" if adam is None else _reached(trace, adam["trace"]["loss"], part) for part in _PARTS]
        counts = [str(trace[name][-1]) for name in ("step", "relaxations")]
        times = [tables.seconds(trace["seconds"][-1]), *tables.show(row, "first_s")]
        return [*reached, f"{min(trace['loss']):.3g}", *counts, *times]

    return tables.of_rows(head, rows, lambda row: [_OPTIMISERS[row["case"]["optimiser"]]], cells)


def _reached(trace: dict[str, list], adam: list[float], part: float) -> str:
    level = adam[0] - part * (adam[0] - min(adam))
    found = next((i for i, loss in enumerate(trace["loss"]) if loss <= level * (1 + 1e-9)), None)
    return "never" if found is None else f"{trace['relaxations'][found]}, {tables.seconds(trace['seconds'][found])}"
