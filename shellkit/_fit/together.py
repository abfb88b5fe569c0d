"""Many fits that advance together in one compiled step, by `jax.lax.map` or `jax.vmap`. A fit that is refused takes a
shorter step by itself, and one that fails does not stop the others."""

import time
from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._problem.problem import InverseProblem
from .choices import Refuse
from .design import Bounds, Design, split
from .history import History
from .loop import Loop, Run, objection, with_terms
from .methods.base import Course, Method, Objective
from .step import evaluate, move, strong


class Seen(NamedTuple):
    """What a step of a fit found, and whether its design was accepted."""

    accepted: Bool[Array, ""]
    loss: Float[Array, ""]
    terms: dict[str, Array]
    gradient_norm: Float[Array, ""]
    diagnostics: dict[str, Array]
    scale: Float[Array, ""]


def fit_together(
    problems: Sequence[Any],
    method: Method,
    how: Literal["map", "vmap"],
    keep: Callable[[int, Any], None],
    *,
    steps: int,
    where: Callable[[Any], Any] | None,
    bounds: Sequence[Bounds],
    refuse: Refuse = Refuse(),
) -> None:
    """Fits problems of one kind side by side, from rest; `keep` is given the number of each and its result, or the
    exception it failed with, when it ends.

    **Raises:** `ValueError` for problems that are not of one kind, or that cannot be batched.
    """
    if how == "vmap" and any(isinstance(problem, InverseProblem) for problem in problems):
        raise ValueError(
            "fit_many: the sparse solver behind the relaxation and the gradient of an InverseProblem cannot be batched "
            'by jax.vmap; use together="map".'
        )
    began = time.perf_counter()
    pairs = [split(problem, where, bounds) for problem in problems]
    _check_one_kind(pairs)
    loops = [Loop(design, method, refuse) for design, _ in pairs]
    shared, own = _common([design for design, _ in pairs])
    runs = _stack([loop.begin(values) for loop, (_, values) in zip(loops, pairs, strict=True)])
    histories = [History() for _ in problems]
    refused = np.zeros(len(problems), int)
    running = np.ones(len(problems), bool)
    while running.any():
        on = (jnp.asarray(running), jnp.asarray(steps))
        runs, seen = _sweep(shared, own, runs, *on, method, how, refuse.unconverged)
        rows, at = jax.device_get((seen, runs.step))
        seconds = time.perf_counter() - began
        for n in np.flatnonzero(running):
            row: Any = jax.tree.map(lambda leaf, n=n: leaf[n].item(), rows)
            beyond = histories[n].steps == steps  # the design after the last update: no row, and no second try
            if row.accepted and not beyond:
                tail = {"refused": int(refused[n]), "update_scale": row.scale, "seconds": seconds}
                others = {"gradient_norm": row.gradient_norm, **row.diagnostics, **tail}
                histories[n].append(with_terms(row.loss, row.terms, others))
                refused[n] = 0
                continue
            refused[n] += 1
            if not beyond and at[n] > 0 and refused[n] <= refuse.most:
                continue
            running[n] = False
            if at[n] == 0:
                wrong = objection(refuse, row.loss, row.diagnostics) or "the gradient is not finite"
                keep(int(n), ValueError(f"fit cannot begin: the starting design is not acceptable: {wrong}."))
            else:
                run = jax.tree.map(lambda leaf, n=n: leaf[n], runs)
                keep(int(n), loops[n].result(run, histories[n], "steps" if beyond else "refused"))


@eqx.filter_jit
def _sweep(
    shared: Design,
    own: Design,
    runs: Run,
    running: Bool[Array, " n"],
    steps: Int[Array, ""],
    method: Method,
    how: str,
    refuses_unconverged: bool,
) -> tuple[Run, Seen]:
    """The next step of each fit that runs; under `vmap` the others go on as well, and their results are dropped."""

    def step(parts: tuple[Design, Run]) -> tuple[Run, Seen]:
        arrays, run = parts
        design, course = eqx.combine(shared, arrays), run.course
        found = evaluate(design, move(course.anchor, course.update, jnp.asarray(course.scale)), None)
        assert found.gradient_norm is not None
        sound = jnp.isfinite(found.loss) & jnp.isfinite(found.gradient_norm)
        if refuses_unconverged:
            sound = sound & found.diagnostics.get("converged", jnp.array(True))
        best = run._replace(best=found.values, best_loss=found.loss, best_step=run.step)
        better = _select(found.loss < run.best_loss, best, run)
        update, state = strong(method.update(Objective(design), found, course.state))
        ahead = better._replace(
            step=run.step + 1,
            course=Course(found.free, update, jnp.minimum(1.0, 2 * course.scale), state),
            last=found.values,
        )
        # The design after the last update has its chance to be the best one, and nothing more.
        ahead = _select(run.step < steps, ahead, better)
        shorter = run._replace(course=method.refuse(course))
        seen = Seen(sound, found.loss, found.terms, found.gradient_norm, found.diagnostics, jnp.asarray(course.scale))
        return _select(sound, ahead, shorter), seen

    if how == "vmap":
        return jax.vmap(step)((own, runs))

    def turn(parts: tuple[Design, Run, Bool[Array, ""]]) -> tuple[Run, Seen]:
        arrays, run, on = parts
        blank = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), jax.eval_shape(step, (arrays, run))[1])
        return jax.lax.cond(on, step, lambda parts: (parts[1], blank), (arrays, run))

    return jax.lax.map(turn, (own, runs, running))


def _select(condition: Bool[Array, ""], one: Run, other: Run) -> Run:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), one, other)


def _check_one_kind(pairs: Sequence[Any]) -> None:
    kinds = {(jax.tree.structure(pair), *map(np.shape, jax.tree.leaves(pair))) for pair in pairs}
    if len(kinds) > 1:
        raise ValueError(
            "fit_many: problems that are fitted together must be of one kind, with the same parts and meshes of the "
            "same size; fit these one after another, with together=None."
        )


def _common(designs: Sequence[Design]) -> tuple[Design, Design]:
    """What all designs share, arrays that are equal included; and the arrays that differ, stacked, absent elsewhere."""
    shared, own = [], []
    for column in zip(*map(jax.tree.leaves, designs), strict=True):
        same = all(leaf is column[0] or _equal(leaf, column[0]) for leaf in column)
        shared.append(column[0] if same else None)
        own.append(None if same else jnp.stack(column))
    structure = jax.tree.structure(designs[0])
    return structure.unflatten(shared), structure.unflatten(own)


def _equal(one: Any, other: Any) -> bool:
    if eqx.is_array(one) and jnp.issubdtype(one.dtype, jax.dtypes.prng_key):
        return False
    return bool(np.array_equal(one, other))


def _stack(trees: Sequence[Any]) -> Any:
    return strong(jax.tree.map(lambda *leaves: jnp.stack(list(map(jnp.asarray, leaves))), *trees))
