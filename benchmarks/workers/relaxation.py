"""How a minimiser closes in on the minimum: force and distance against time, step by step."""

import itertools
import statistics
import time
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx

import shellkit as sk
from shellkit._geometry.surface import edge_lengths
from shellkit._relaxation.minimise import minimiser_options

from ..measure import Stage
from .problems import design_problem, teacher


# Without a tolerance, so that each goes on to where rounding stops it.
_MINIMISERS = {
    "SparseNewton": sk.SparseNewton,
    "NonlinearCG": lambda: optx.NonlinearCG(rtol=0.0, atol=0.0),
    "BFGS": lambda: optx.BFGS(rtol=0.0, atol=0.0),
    "LBFGS": lambda: optx.LBFGS(rtol=0.0, atol=0.0),
}


class _Descent(eqx.Module):
    """A minimiser at work on one problem, a few steps at a time, without what `InverseProblem` does at the end."""

    problem: sk.InverseProblem
    solver: optx.AbstractMinimiser

    def _scene(self) -> tuple[Any, None, dict[str, Any]]:
        """Function, arguments and options, as `InverseProblem` gives them to a minimiser."""
        energy, mesh = self.problem.discrete_energy(), self.problem.mesh
        length = jnp.mean(edge_lengths(mesh.vertices, mesh))
        options = minimiser_options(energy, self.problem.rigid_motions(energy), length)
        return lambda y, _: (energy(y), None), None, options

    @eqx.filter_jit
    def start(self) -> tuple[jax.Array, Any]:
        y = self.problem.mesh.vertices.reshape(-1)
        return y, self.solver.init(*_around(y, self._scene()), jax.ShapeDtypeStruct((), y.dtype), None, frozenset())

    @eqx.filter_jit
    def advance(self, y: jax.Array, state: Any, steps: jax.Array) -> tuple[jax.Array, Any, jax.Array, jax.Array]:
        """At most so many steps more: where they led, how many there were, and whether it is over."""
        scene = self._scene()
        arrays, rest = eqx.partition(state, eqx.is_array)

        def over(y, arrays):
            return self.solver.terminate(*_around(y, scene), eqx.combine(arrays, rest), frozenset())[0]

        def step(carry):
            y, arrays, count = carry
            y, state, _ = self.solver.step(*_around(y, scene), eqx.combine(arrays, rest), frozenset())
            return y, eqx.filter(state, eqx.is_array), count + 1

        on = lambda carry: (carry[2] < steps) & ~over(carry[0], carry[1])
        y, arrays, count = jax.lax.while_loop(on, step, (y, arrays, jnp.zeros_like(steps)))
        return y, eqx.combine(arrays, rest), count, over(y, arrays)

    def descend(self, max_steps: int, limit_s: float) -> tuple[list[float], list[int], list[jax.Array]]:
        """From rest on: the seconds of each piece, the steps taken by its end, and the unknowns there."""
        begun = time.perf_counter()
        y, state = jax.block_until_ready(self.start())
        seconds, counts, shapes = [time.perf_counter() - begun], [0], [y]
        done, goal = False, 1
        while not done and counts[-1] < max_steps and sum(seconds) < limit_s:
            begun = time.perf_counter()
            y, state, count, done = jax.block_until_ready(self.advance(y, state, jnp.asarray(goal - counts[-1])))
            seconds.append(time.perf_counter() - begun)
            counts.append(counts[-1] + int(count))
            shapes.append(y)
            goal = max(goal + 1, int(1.35 * goal))
        return seconds, counts, shapes


def _around(y: jax.Array, scene: tuple[Any, None, dict[str, Any]]) -> tuple:
    fn, args, options = scene
    return fn, y, args, options


def measure(mesh: str, field: str, minimiser: str, max_steps: int, limit_s: float, runs: int) -> dict:
    """Force, distance to the minimum and energy above it after 1, 2, 3, 4, 5, 6, 8 … steps, and the time it took to get
    there: the median over `runs` descents."""
    shell = sk.Mesh.read(mesh)
    problem = teacher(shell) if field == "teacher" else design_problem(shell, "sphericity", 1.5, field, form="tan")
    minimum = eqx.filter_jit(lambda problem: problem())(problem)
    descent = _Descent(problem, _MINIMISERS[minimiser]())

    with Stage() as compilation:
        y, state = descent.start()
        jax.block_until_ready(descent.advance(y, state, jnp.asarray(0)))
    descents = [descent.descend(max_steps, limit_s) for _ in range(runs)]
    _, counts, shapes = descents[0]
    pieces = zip(*(seconds for seconds, _, _ in descents), strict=False)
    times = itertools.accumulate(map(statistics.median, pieces))

    trace = [
        {"steps": count, "seconds": seconds, **jax.tree.map(float, _gauge(problem, minimum, y))}
        for seconds, count, y in zip(times, counts, shapes, strict=False)
    ]
    return {"compile_s": compilation.seconds, "trace": trace, "minimum_converged": bool(minimum.converged)}


@eqx.filter_jit
def _gauge(problem: sk.InverseProblem, minimum: sk.Equilibrium, y: jax.Array) -> dict[str, jax.Array]:
    """How far a shape is from the minimum."""
    vertices = y.reshape(-1, 3)
    energy, force = jax.value_and_grad(problem.total_energy)(vertices)
    apart = sk.Kabsch()(vertices, minimum.vertices) - minimum.vertices
    return {
        "force": jnp.linalg.norm(force),
        "distance": jnp.max(jnp.linalg.norm(apart, axis=1)),
        "energy_above": energy - minimum.energy,
    }
