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
from .design import Bounds, Design, split
from .history import FitResult, History
from .step import advance, evaluate, move, strong


class Lane(eqx.Module):
    """One of the fits between two steps: where it goes next, the last design that was accepted, and the best one."""

    anchor: dict[str, Array]
    update: dict[str, Array]
    scale: Float[Array, ""]
    state: Any
    last: dict[str, Array]
    best: dict[str, Array]
    best_loss: Float[Array, ""]
    best_step: Int[Array, ""]
    step: Int[Array, ""]


class Seen(NamedTuple):
    """What a step of a lane found, and whether its design was accepted."""

    accepted: Bool[Array, ""]
    loss: Float[Array, ""]
    terms: dict[str, Array]
    gradient_norm: Float[Array, ""]
    diagnostics: dict[str, Array]
    scale: Float[Array, ""]


def fit_together(
    problems: Sequence[Any],
    optimiser: Any,
    how: Literal["map", "vmap"],
    keep: Callable[[int, Any], None],
    *,
    steps: int,
    where: Callable[[Any], Any] | None,
    bounds: Sequence[Bounds],
    unconverged: Literal["refuse", "accept"] = "refuse",
    max_refusals: int = 8,
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
    designs = [design for design, _ in pairs]
    shared, own = _common(designs)
    lanes = _stack([_begin(optimiser, design, values) for design, values in pairs])
    histories = [History() for _ in problems]
    refused = np.zeros(len(problems), int)
    running = np.ones(len(problems), bool)
    while running.any():
        on = (jnp.asarray(running), jnp.asarray(steps))
        lanes, seen = _sweep(shared, own, lanes, *on, optimiser, how, unconverged == "refuse")
        rows, at = jax.device_get((seen, lanes.step))
        seconds = time.perf_counter() - began
        for n in np.flatnonzero(running):
            row: Any = jax.tree.map(lambda leaf, n=n: leaf[n].item(), rows)
            beyond = histories[n].steps == steps  # the design after the last update: no row, and no second try
            if row.accepted and not beyond:
                tail = {"refused": int(refused[n]), "update_scale": row.scale, "seconds": seconds}
                head = {"loss": row.loss, **row.terms, "gradient_norm": row.gradient_norm}
                histories[n].append({**head, **row.diagnostics, **tail})
                refused[n] = 0
                continue
            refused[n] += 1
            if not beyond and at[n] > 0 and refused[n] <= max_refusals:
                continue
            running[n] = False
            if at[n] == 0:
                keep(int(n), ValueError(f"fit cannot begin: the starting design is not acceptable ({_objection(row)})"))
            else:
                lane = jax.tree.map(lambda leaf, n=n: leaf[n], lanes)
                keep(int(n), _result(designs[n], lane, histories[n], "steps" if beyond else "refused"))


def _begin(optimiser: Any, design: Design, values: dict[str, Array]) -> Lane:
    free = strong(design.free(values))
    return Lane(
        anchor=free,
        update=jax.tree.map(jnp.zeros_like, free),
        scale=jnp.ones(()),
        state=strong(optimiser.init(free)),
        last=values,
        best=values,
        best_loss=jnp.asarray(jnp.inf),
        best_step=jnp.zeros((), jnp.int32),
        step=jnp.zeros((), jnp.int32),
    )


@eqx.filter_jit
def _sweep(
    shared: Any,
    own: Any,
    lanes: Lane,
    running: Bool[Array, " n"],
    steps: Int[Array, ""],
    optimiser: Any,
    how: str,
    refuses_unconverged: bool,
) -> tuple[Lane, Seen]:
    """The next step of each lane that runs; under `vmap` the others go on as well, and nobody looks."""

    def step(parts: tuple[Any, Lane]) -> tuple[Lane, Seen]:
        arrays, lane = parts
        design = eqx.combine(shared, arrays)
        free = move(lane.anchor, lane.update, lane.scale)
        found = evaluate(design, free, None)
        assert found.gradient is not None and found.gradient_norm is not None
        sound = jnp.isfinite(found.loss) & jnp.isfinite(found.gradient_norm)
        if refuses_unconverged:
            sound = sound & found.diagnostics.get("converged", jnp.array(True))
        update, state = advance(optimiser, design, (free, found.loss, found.gradient), lane.state, None)
        better = found.loss < lane.best_loss
        best = jax.tree.map(lambda new, old: jnp.where(better, new, old), found.values, lane.best)
        ahead = Lane(
            anchor=free,
            update=update,
            scale=jnp.minimum(1.0, 2 * lane.scale),
            state=state,
            last=found.values,
            best=best,
            best_loss=jnp.where(better, found.loss, lane.best_loss),
            best_step=jnp.where(better, lane.step, lane.best_step),
            step=lane.step + 1,
        )
        # The design after the last update has its chance to be the best one, and nothing more.
        found_best = (best, ahead.best_loss, ahead.best_step)
        over = eqx.tree_at(lambda at: (at.best, at.best_loss, at.best_step), lane, found_best)
        ahead = jax.tree.map(lambda there, on: jnp.where(lane.step < steps, on, there), over, ahead)
        shorter = eqx.tree_at(lambda at: at.scale, lane, lane.scale / 2)
        seen = Seen(sound, found.loss, found.terms, found.gradient_norm, found.diagnostics, lane.scale)
        return jax.tree.map(lambda new, old: jnp.where(sound, new, old), ahead, shorter), seen

    if how == "vmap":
        return jax.vmap(step)((own, lanes))

    def turn(parts: tuple[Any, Lane, Bool[Array, ""]]) -> tuple[Lane, Seen]:
        arrays, lane, on = parts
        blank = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), jax.eval_shape(step, (arrays, lane))[1])
        return jax.lax.cond(on, step, lambda parts: (parts[1], blank), (arrays, lane))

    return jax.lax.map(turn, (own, lanes, running))


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
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *trees)


def _objection(row: Seen) -> str:
    if not np.isfinite(row.loss):
        return f"the loss is {row.loss}"
    if not np.isfinite(row.gradient_norm):
        return "the gradient is not finite"
    return f"the relaxation did not converge, |∇E| = {row.diagnostics['relaxation_gradient_norm']:.3g}"


def _result(design: Design, lane: Lane, history: History, stopped: str) -> FitResult:
    return FitResult(
        problem=design.problem(lane.best),
        best_loss=float(lane.best_loss),
        best_step=int(lane.best_step),
        equilibrium=None,
        last_problem=design.problem(lane.last),
        history=history,
        stopped=stopped,
        state=lane.state,
    )
