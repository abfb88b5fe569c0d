"""Relaxation: force and distance to the minimum against time, for SparseNewton and optimistix's minimisers."""

import itertools
import statistics
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

import shellkit as sk
from shellkit._geometry.surface import edge_lengths
from shellkit._relaxation.minimise import minimiser_options

from .. import tables
from ..case import Case, Row
from ..measure import Stage, timed
from ..problems import design_problem, relaxed, teacher


class Scene(NamedTuple):
    """What is relaxed on a mesh."""

    field: str
    name: str
    details: str


SCENES = {
    "icosphere-1": Scene("teacher", "42 vertices", "teacher, λ = 1.1"),
    "icosphere-3": Scene("teacher", "642 vertices", "teacher, λ = 1.1"),
    "suzanne": Scene("random", "Suzanne, 1400 vertices", 'neo-Hookean, `form="tan"`, random directors, λ = 1.5'),
}
# Without a tolerance, so that each goes on to where rounding stops it.
_MINIMISERS = {
    "SparseNewton": sk.SparseNewton,
    "NonlinearCG": lambda: optx.NonlinearCG(rtol=0.0, atol=0.0),
    "BFGS": lambda: optx.BFGS(rtol=0.0, atol=0.0),
    "LBFGS": lambda: optx.LBFGS(rtol=0.0, atol=0.0),
}
_FORCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)


def cases(quick: bool) -> list[Case]:
    found, limits = [], {"max_steps": 20_000, "limit_s": 20.0, "runs": 3}
    for (mesh, scene), minimiser in itertools.product(SCENES.items(), _MINIMISERS):
        # BFGS keeps a dense matrix.
        if mesh == "icosphere-1" or (minimiser != "BFGS" and not quick):
            arguments = {"mesh": mesh, "field": scene.field, "minimiser": minimiser} | limits
            arguments |= {"max_steps": 1000, "limit_s": 5.0, "runs": 1} if quick else {}
            found.append(Case(f"{mesh} {minimiser}", "questions.relaxation", arguments))
    return found


@eqx.filter_jit
def _descend(problem: sk.InverseProblem, solver: optx.AbstractMinimiser, most: jax.Array) -> tuple[jax.Array, Any]:
    """From rest, at most so many steps: where they led, and how many there were. Function and options are those that
    `InverseProblem` gives to a minimiser, but nothing is done at the end."""
    energy, mesh = problem.discrete_energy(), problem.mesh
    options = minimiser_options(energy, problem.rigid_modes(energy), jnp.mean(edge_lengths(mesh.vertices, mesh)))
    around = lambda y: (lambda y, _: (energy(y), None), y, None, options)
    y = mesh.vertices.reshape(-1)
    state = solver.init(*around(y), jax.ShapeDtypeStruct((), y.dtype), None, frozenset())
    arrays, rest = eqx.partition(state, eqx.is_array)

    def on(carry):
        y, arrays, count = carry
        return (count < most) & ~solver.terminate(*around(y), eqx.combine(arrays, rest), frozenset())[0]

    def step(carry):
        y, arrays, count = carry
        y, state, _ = solver.step(*around(y), eqx.combine(arrays, rest), frozenset())
        return y, eqx.filter(state, eqx.is_array), count + 1

    y, _, count = jax.lax.while_loop(on, step, (y, arrays, jnp.zeros_like(most)))
    return y, count


def measure(mesh: str, field: str, minimiser: str, max_steps: int, limit_s: float, runs: int) -> dict:
    """Force and distance to the minimum after 1, 2, 3, 4, 5, 6, 8 … steps, and the time it takes to get there from
    rest: the median over `runs` descents. A descent that takes longer than the limit is the last."""
    shell = sk.Mesh.read(mesh)
    problem = teacher(shell) if field == "teacher" else design_problem(shell, "sphericity", 1.5, field, form="tan")
    minimum = eqx.filter_jit(relaxed)(problem)
    descend = partial(_descend, problem, _MINIMISERS[minimiser]())
    with Stage() as compilation:
        jax.block_until_ready(descend(jnp.asarray(0)))
    trace, goal = [], 0
    while not trace or (trace[-1]["steps"] == goal < max_steps and trace[-1]["seconds"] < limit_s):
        goal = min(max(goal + 1, int(1.35 * goal)), max_steps) if trace else 0
        (y, steps), record = timed(descend, jnp.asarray(goal), runs=runs)
        seconds = statistics.median(record["run_s"])
        trace.append({"steps": int(steps), "seconds": seconds, **jax.tree.map(float, _gauge(problem, minimum, y))})
    # A descent of more steps passes through those of fewer, which so took no longer.
    for earlier, later in reversed(list(itertools.pairwise(trace))):
        earlier["seconds"] = min(earlier["seconds"], later["seconds"])
    return {"compile_s": compilation.seconds, "trace": trace, "minimum_converged": bool(minimum.converged)}


@eqx.filter_jit
def _gauge(problem: sk.InverseProblem, minimum: sk.Equilibrium, y: jax.Array) -> dict[str, jax.Array]:
    """How far a shape is from the minimum."""
    vertices = y.reshape(-1, 3)
    force = jax.grad(problem.total_energy)(vertices)
    apart = sk.Kabsch()(vertices, minimum.vertices) - minimum.vertices
    return {"force": jnp.linalg.norm(force), "distance": jnp.max(jnp.linalg.norm(apart, axis=1))}


def page(rows: list[Row]) -> str:
    titles = {mesh: f"{scene.name}, {scene.details}" for mesh, scene in SCENES.items()}
    return tables.sections(titles, rows, "mesh", _table)


def _table(rows: list[Row]) -> str:
    below = [f"&#124;∇E&#124; < {bound:.0e}" for bound in _FORCES]
    head = ("", *below, "end: &#124;∇E&#124;", "distance", "steps", "time")

    def cells(row: Row) -> list[str]:
        trace = row["trace"]
        best = int(np.argmin(trace["force"]))
        reached = [next((i for i, force in enumerate(trace["force"]) if force < bound), None) for bound in _FORCES]
        return [
            *("never" if index is None else tables.seconds(trace["seconds"][index]) for index in reached),
            tables.small(trace["force"][best]),
            tables.small(trace["distance"][best]),
            str(trace["steps"][best]),
            tables.seconds(trace["seconds"][best]),
        ]

    return tables.of_rows(head, rows, lambda row: [row["case"]["minimiser"]], cells)
