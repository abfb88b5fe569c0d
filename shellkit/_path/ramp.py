"""Relaxation along a path: actuation, loads and prescribed motion come on in steps, each from the last equilibrium.

A shell driven far at once may end in another state than the one an experiment leads it to, or nowhere. The steps adapt:
they are halved where a relaxation fails and grow again where it succeeds.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Scalar

from .._energy import Unknowns
from .._equilibrium import RESULTS, Equilibrium
from .._problem.problem import InverseProblem
from .._programs.tracing import frozen, is_traced, with_parts
from .._relaxation.relaxed import Start


_WHOLE = 1 + 1e-9  # a remainder of so many increments is taken in one


class Ramp(eqx.Module):
    """Even steps from nothing to the whole of actuation, loads and prescribed motion, smaller ones where needed.

    A relaxation that does not converge is tried again with half the step; after a success the step doubles, up to the
    one that `steps` gives. Each relaxation starts from the straight line through the last two equilibria. One that
    fails costs all the steps that the solver may take; where that happens, `SparseNewton(max_steps=40)` saves time.
    """

    steps: int = eqx.field(static=True)
    halvings: int = eqx.field(static=True)

    def __init__(self, steps: int = 8, halvings: int = 6):
        """**Arguments:**

        - `steps`: how many there are if all goes well.
        - `halvings`: how often a step may be halved before the ramp gives up.

        **Raises:**

        `ValueError` if `steps` is less than one or `halvings` is negative.
        """
        if steps < 1 or halvings < 0:
            raise ValueError(
                f"Ramp(steps={steps}, halvings={halvings}): give at least one step, and no negative number of halvings."
            )
        self.steps = steps
        self.halvings = halvings


class Path(eqx.Module):
    """The equilibria along a path; printing it shows them as a table.

    The path ended early if `complete` is false: `failures` says how far it tried to go from there and why that failed.
    """

    progress: Float[Array, " n"]
    """How much of actuation, loads and motion is on at each equilibrium; 1 is all of it."""
    equilibria: tuple[Equilibrium, ...]
    """One for each entry of `progress`. Their `rest` is that of the moment."""
    failures: tuple[tuple[float, str], ...]
    """The progress at which a relaxation was tried and did not converge, and the reason."""

    @property
    def complete(self) -> bool:
        """Whether the end was reached."""
        return len(self.equilibria) > 0 and float(self.progress[-1]) == 1.0

    @property
    def vertices(self) -> Float[Array, "n V 3"]:
        """Positions along the path."""
        return jnp.stack([equilibrium.vertices for equilibrium in self.equilibria])

    @property
    def energies(self) -> Float[Array, " n"]:
        """Energies along the path."""
        return jnp.stack([equilibrium.energy for equilibrium in self.equilibria])

    def __str__(self) -> str:
        lines = ["progress  steps        energy   |gradient|"]
        for progress, at in zip(self.progress, self.equilibria, strict=True):
            figures = f"{int(at.steps):5d}  {float(at.energy):12.5e}  {float(at.gradient_norm):11.2e}"
            lines.append(f"{float(progress):8.5f}  {figures}" + ("" if at.stable else "  unstable"))
        lines += [f"tried {progress:.5f}: {reason}" for progress, reason in self.failures]
        return "\n".join(lines)


def relax(problem: InverseProblem, path: Ramp | None = None, start: Equilibrium | None = None) -> Equilibrium:
    """Relax a shell, along a path if one is given.

    The path itself is not differentiated, its end is: like `problem()`, the result is a function of every array of the
    problem, forwards and backwards. It may be called under `jax.jit` and `jax.vmap`; the path then adapts all the same.

    **Arguments:**

    - `problem`: the shell.
    - `path`: such as [`shellkit.Ramp`][]; `None` relaxes at once.
    - `start`: an equilibrium to start from; by default the surface at rest.

    **Returns:**

    The equilibrium of `problem`, with all of its actuation and loads. Where the path ended early, that is what a last
    attempt to go the whole rest of the way at once came to: look at `converged` and `result`, and use
    [`shellkit.follow`][] to see how far the path went.

    ??? example

        ```python
        equilibrium = sk.relax(problem, path=sk.Ramp(8))
        ```
    """
    if path is None:
        return problem(start)
    still = frozen(problem)
    walk, goes_on = _Walk.from_rest(still, path, start), _goes_on(path)
    if is_traced((still, start)):
        walk = jax.lax.while_loop(goes_on, lambda walk: _advance(still, path, walk)[0], walk)
    else:
        while goes_on(walk):
            walk, _, _ = _advance(still, path, walk)
    return _relax_at(problem, jnp.ones(()), walk.unknowns)


def follow(problem: InverseProblem, path: Ramp | None = None, start: Equilibrium | None = None) -> Path:
    """Relax a shell along a path and keep every equilibrium on the way: for films, for load–displacement curves, or to
    see why a path ends early.

    Not for use under `jax.jit`, where the number of steps is not known; [`shellkit.relax`][] is.

    **Arguments:**

    - `problem`: the shell.
    - `path`: by default `Ramp()`.
    - `start`: an equilibrium to start from; by default the surface at rest.

    **Returns:**

    The [`shellkit.Path`][]; its equilibria are not differentiable.

    **Raises:**

    `ValueError` under `jax.jit` and other transformations.
    """
    still = frozen(problem)
    if is_traced((still, start)):
        raise ValueError("follow keeps as many equilibria as the path takes steps, so it cannot be traced: use relax.")
    path = Ramp() if path is None else path
    walk, goes_on = _Walk.from_rest(still, path, start), _goes_on(path)
    progress, equilibria, failures = [], [], []
    while goes_on(walk):
        walk, tried, equilibrium = _advance(still, path, walk)
        if equilibrium.converged:
            progress.append(float(tried))
            equilibria.append(equilibrium)
        else:
            failures.append((float(tried), RESULTS[equilibrium.result]))
    return Path(jnp.asarray(progress), tuple(equilibria), tuple(failures))


class _Walk(eqx.Module):
    """Where a path has come to: the last two equilibria on it, and the increment to try next."""

    progress: Scalar
    unknowns: Unknowns
    last_progress: Scalar
    last_unknowns: Unknowns
    increment: Scalar

    @classmethod
    def from_rest(cls, problem: InverseProblem, path: Ramp, start: Equilibrium | None) -> "_Walk":
        """The beginning, where the two equilibria are one."""
        unknowns = jax.lax.stop_gradient(Start.of(problem.mesh, problem.assembly, start).unknowns)
        return cls(jnp.zeros(()), unknowns, jnp.zeros(()), unknowns, jnp.asarray(1 / path.steps, dtype=float))


def _goes_on(path: Ramp) -> Callable[[_Walk], Bool[Array, ""]]:
    """Whether a walk has some way to go, and may still take a step."""
    smallest = 1 / path.steps / 2**path.halvings
    return lambda walk: (walk.progress < 1) & (walk.increment >= smallest)


def _advance(problem: InverseProblem, path: Ramp, walk: _Walk) -> tuple[_Walk, Scalar, Equilibrium]:
    """One attempt: predict, relax, and go there if that converged. Also what was tried, and what came of it."""
    left = 1 - walk.progress
    tried = jnp.where(left <= _WHOLE * walk.increment, 1.0, walk.progress + walk.increment)
    covered = walk.progress - walk.last_progress
    ratio = jnp.where(covered > 0, (tried - walk.progress) / jnp.where(covered > 0, covered, 1.0), 0.0)
    guess = jax.tree.map(lambda now, last: now + ratio * (now - last), walk.unknowns, walk.last_unknowns)
    equilibrium = _relax_at(problem, tried, guess)
    increment = jnp.minimum(2 * walk.increment, 1 / path.steps)
    there = _Walk(tried, equilibrium.unknowns, walk.progress, walk.unknowns, increment)
    back = eqx.tree_at(lambda w: w.increment, walk, 0.5 * walk.increment)
    walk = jax.tree.map(lambda new, old: jnp.where(equilibrium.converged, new, old), there, back)
    return walk, tried, equilibrium


def _relax_at(problem: InverseProblem, progress: Scalar, unknowns: Unknowns) -> Equilibrium:
    """Relax with a part of actuation and loads on: compiled once, however many steps a path takes."""
    actuation, energy, supports = _parts_at(problem, progress)
    part = with_parts(problem, actuation=actuation, energy=energy, supports=supports)
    return part(Start(unknowns, None))


@eqx.filter_jit
def _parts_at(problem: InverseProblem, progress: Scalar) -> tuple:
    part = problem.at(progress)
    return part.actuation, part.energy, part.supports
