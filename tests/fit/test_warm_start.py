"""Relaxations that start where the last one ended, on a double well whose branches are known."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from shellkit._fit.choices import Refuse, WarmStart
from shellkit._fit.design import split
from shellkit._fit.fit import fit
from shellkit._fit.step import evaluate, predict


@pytest.mark.parametrize("guess", ["last", "predicted"])
def test_gives_the_same_fit_where_there_is_one_branch(make_wells, angle, guess):
    problem = make_wells(0.0, 1.3)
    rest = fit(problem, optax.adam(0.05), steps=40, where=angle)
    warm = fit(problem, optax.adam(0.05), steps=40, where=angle, warm_start=WarmStart(guess, check_every=10))
    np.testing.assert_allclose(warm.history["loss"], rest.history["loss"], atol=1e-9)
    checked = ~np.isnan(warm.history["warm_gap"])
    np.testing.assert_array_equal(np.flatnonzero(checked), [10, 20, 30])
    np.testing.assert_allclose(warm.history["warm_gap"][checked], 0, atol=1e-9)
    assert "warm_gap" not in rest.history


def test_warns_when_the_branches_part(make_wells, angle):
    # The upper well ends at a load of -2/(3√3) = -0.385. Beyond it the point falls into the lower one, and when the
    # load returns it is back in the upper one from rest, and stays in the lower one if warm.
    loads = [0.0, -0.3, -0.5, -0.2, -0.1, 0.0]
    steps = jnp.asarray(np.diff(loads))
    follow = optax.GradientTransformation(
        lambda params: jnp.zeros((), jnp.int32),
        lambda grads, state, params=None: (
            {name: steps[state] * jnp.ones_like(g) for name, g in grads.items()},
            state + 1,
        ),
    )
    with pytest.warns(UserWarning, match="at step 4 the warm-started relaxation has parted"):
        warm = fit(make_wells(0.0, -1.0), follow, steps=5, where=angle, warm_start=WarmStart("last", check_every=2))
    roots = np.roots([1, 0, -1, 0.1]).real  # the equilibria at a load of -0.1
    lower, upper = (roots.min() + 1) ** 2, (roots.max() + 1) ** 2
    np.testing.assert_allclose(warm.history["loss"][4], lower, rtol=1e-8)
    np.testing.assert_allclose(warm.history["warm_gap"][4], lower - upper, rtol=1e-8)
    assert np.isnan(warm.history["warm_gap"][[0, 1, 3]]).all() and abs(warm.history["warm_gap"][2]) < 1e-9


def steady(step):
    """An optimiser that makes the same step over and over."""
    return optax.GradientTransformation(
        lambda params: optax.EmptyState(),
        lambda grads, state, params=None: (jax.tree.map(lambda g: jnp.full_like(g, step), grads), state),
    )


def test_a_leap_of_the_loss_is_turned_down(make_wells, angle):
    # The upper well ends at a load of -0.385: of the second step of -0.3, a quarter stays above.
    run = lambda **options: fit(
        make_wells(0.0, 1.5), steady(-0.3), steps=3, where=angle, warm_start=WarmStart(), **options
    )
    fallen, kept = run(), run(refuse=Refuse(rise=2.0))
    np.testing.assert_allclose(fallen.history["loss"][:2], kept.history["loss"][:2])
    upper = np.roots([1, 0, -1, 0.375]).real.max()
    np.testing.assert_allclose(kept.history["loss"][2], (upper - 1.5) ** 2, rtol=1e-7)
    assert fallen.history["loss"][2] > 3 and list(kept.history["refused"]) == [0, 0, 2]
    np.testing.assert_array_equal(kept.history["update_scale"], [1, 1, 0.25])


def test_after_four_leaps_the_next_is_taken(make_quadratic, angle):
    # Uphill at any length: the fifth attempt, a sixteenth of the step, is not turned down.
    uphill = fit(make_quadratic(), optax.sgd(-10.0), steps=2, where=angle, refuse=Refuse(rise=0.0))
    assert list(uphill.history["refused"]) == [0, 4] and uphill.history["update_scale"][1] == 1 / 16


def test_the_prediction_is_the_first_order_one(make_wells, angle):
    # v + dv/dload · step, with dv/dload = 1/(3v² - 1).
    design, values = split(make_wells(0.1, 0.0), angle)
    there = evaluate(design, values, None).equilibrium
    v = there.vertices
    moved = {"actuation.angle": values["actuation.angle"] + 0.01}
    np.testing.assert_allclose(predict(design, values, moved, there).vertices, v + 0.01 / (3 * v**2 - 1), rtol=1e-12)


@pytest.mark.parametrize("guess", [None, "last", "predicted"])
def test_where_a_relaxation_starts(make_quadratic, angle, guess):
    starts = []

    class Watched(eqx.Module):
        actuation: eqx.Module

        def objective(self, start=None):
            if start is not None:
                jax.debug.callback(lambda v: starts.append(np.array(v)), start.vertices)
            return eqx.tree_at(lambda p: p.actuation, make_quadratic(), self.actuation).objective(start)

    seen = []
    watch = lambda info: seen.append(np.asarray(info.equilibrium.vertices))
    fit(
        Watched(make_quadratic().actuation),
        optax.sgd(0.1),
        steps=3,
        where=angle,
        warm_start=None if guess is None else WarmStart(guess),
        callbacks=[watch],
    )
    jax.effects_barrier()
    # As sets: the line of calls may be recorded in any order. The shape is the design, so its first-order prediction is
    # the next shape itself.
    starts, shapes = {start.tobytes() for start in starts}, {shape.tobytes() for shape in seen}
    if guess is None:
        assert not starts
    elif guess == "last":
        assert starts > shapes - {seen[-1].tobytes()} and len(starts) == 3
    else:
        assert starts > shapes - {seen[0].tobytes()}


def test_falls_back_to_rest_when_the_warm_relaxation_fails(make_quadratic, angle):
    class Cold(eqx.Module):
        actuation: eqx.Module

        def objective(self, start=None):
            problem = make_quadratic(limit=jnp.asarray(jnp.inf if start is None else -jnp.inf))
            return eqx.tree_at(lambda p: p.actuation, problem, self.actuation).objective(start)

    problem = Cold(make_quadratic().actuation)
    result = fit(problem, optax.sgd(0.1), steps=4, where=angle, warm_start=WarmStart())
    np.testing.assert_array_equal(result.history["refused"], 0)
    np.testing.assert_array_equal(result.history["solver_steps"], 7)


def test_resumes_from_the_stored_equilibrium(make_wells, angle, tmp_path):
    def run(steps, **options):
        warm_start = WarmStart("predicted")
        return fit(make_wells(0.3, 1.3), optax.adam(0.05), steps=steps, where=angle, warm_start=warm_start, **options)

    run(7, checkpoint=tmp_path / "run")
    resumed, straight = run(13, checkpoint=tmp_path / "run"), run(13)
    for name in set(straight.history) - {"seconds"}:
        np.testing.assert_array_equal(resumed.history[name], straight.history[name])
    np.testing.assert_array_equal(resumed.equilibrium.vertices, straight.equilibrium.vertices)
    np.testing.assert_allclose((resumed.equilibrium.vertices - 1.3) ** 2, resumed.best_loss)
