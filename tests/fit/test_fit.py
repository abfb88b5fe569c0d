"""Training against problems solved on paper: what is trained, recorded, compiled, and when it stops."""

import inspect
import logging

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from shellkit._fit.checkpoint import Checkpoint
from shellkit._fit.choices import Refuse, WarmStart
from shellkit._fit.design import selected
from shellkit._fit.fit import fit
from shellkit._fit.observers import Stop


def test_gradient_descent_follows_its_recursion(make_quadratic, angle):
    result = fit(make_quadratic(), optax.sgd(0.1), steps=30, where=angle)
    # d/dx of (x - t)² + 0.01 x² is 2.02 (x - t/1.01): each step contracts the error by 1 - 0.202.
    target = np.arange(1.0, 4)
    designs = [target / 1.01 * (1 - (1 - 0.202) ** k) for k in range(31)]
    losses = [np.sum((x - target) ** 2 + 0.01 * x**2) for x in designs]
    gradients = [np.linalg.norm(2.02 * (x - target / 1.01)) for x in designs]
    np.testing.assert_allclose(result.history["loss"], losses[:30], rtol=1e-12)
    np.testing.assert_allclose(result.history["Distance"], [np.sum((x - target) ** 2) for x in designs[:30]])
    np.testing.assert_allclose(result.history["Size"], [np.sum(x**2) for x in designs[:30]])
    np.testing.assert_allclose(result.history["gradient_norm"], gradients[:30], rtol=1e-10)
    np.testing.assert_allclose(result.last_problem.actuation.angle, designs[29])
    # The design after the last update is the best one, and has no row.
    np.testing.assert_allclose(result.problem.actuation.angle, designs[30])
    assert result.best_loss == pytest.approx(losses[30]) and result.best_step == 30
    assert result.stopped == "steps"


def test_history_columns(make_quadratic, angle):
    history = fit(make_quadratic(), optax.adam(0.1), steps=5, where=angle).history
    assert set(history) == {
        *("loss", "Distance", "Size", "gradient_norm", "solver_steps", "relaxation_gradient_norm", "converged"),
        *("stable", "refused", "update_scale", "seconds"),
    }
    assert all(len(history[name]) == 5 for name in history) and history.steps == 5
    assert history["converged"].dtype == bool and history["converged"].all()
    assert (history["solver_steps"] == 7).all() and (history["relaxation_gradient_norm"] == 1e-12).all()
    assert (history["refused"] == 0).all() and (history["update_scale"] == 1).all()
    assert (np.diff(history["seconds"]) > 0).all()


def test_best_design_is_kept_when_the_loss_rises(make_quadratic, angle):
    result = fit(make_quadratic(1), optax.sgd(lambda step: jnp.where(step < 5, 0.1, -0.2)), steps=12, where=angle)
    assert result.best_step == 5 == np.argmin(result.history["loss"])
    assert result.best_loss == result.history["loss"].min() < result.history["loss"][-1]
    loss, _ = result.problem.objective()
    assert float(loss) == pytest.approx(result.best_loss, rel=1e-14)


@pytest.mark.parametrize(
    "optimiser",
    [
        optax.adam(optax.cosine_decay_schedule(0.3, 150)),
        optax.chain(optax.clip_by_global_norm(1.0), optax.adam(0.2)),
        optax.lbfgs(),
        optax.chain(optax.sgd(0.2), optax.contrib.reduce_on_plateau(patience=10)),
        optax.contrib.schedule_free_sgd(0.2),
    ],
    ids=["schedule", "chain", "lbfgs", "value", "params"],
)
def test_optimisers_reach_the_minimum(make_quadratic, angle, optimiser):
    problem = make_quadratic()
    result = fit(problem, optimiser, steps=150, where=angle)
    np.testing.assert_allclose(result.problem.actuation.angle, problem.target / 1.01, atol=2e-2)


def test_lbfgs_solves_a_quadratic_in_a_few_steps(make_quadratic, angle):
    problem = make_quadratic(weight=jnp.array([1.0, 10.0, 100.0]))
    result = fit(problem, optax.lbfgs(), steps=15, where=angle)
    exact = problem.target * problem.weight / (problem.weight + 0.01)
    np.testing.assert_allclose(result.problem.actuation.angle, exact, atol=1e-7)


def test_lbfgs_line_search_backs_off_from_failed_relaxations(make_quadratic, angle):
    problem = make_quadratic(1, limit=jnp.asarray(0.5), weight=jnp.full(1, 100.0))
    result = fit(problem, optax.lbfgs(), steps=8, where=angle)
    assert (np.diff(result.history["loss"]) <= 0).all()
    assert 0.4 < float(result.problem.actuation.angle[0]) <= 0.5


def test_only_what_is_picked_is_trained(make_quadratic):
    problem = make_quadratic(start=0.5)
    result = fit(problem, optax.sgd(0.01), steps=3, where=lambda p: (p.weight, p.actuation.stretch)).problem
    assert eqx.tree_equal(result.actuation.angle, problem.actuation.angle)
    assert eqx.tree_equal(result.target, problem.target)
    assert not np.allclose(result.weight, problem.weight)
    assert not np.allclose(result.actuation.stretch, problem.actuation.stretch)


def test_what_is_frozen_is_not_differentiated(make_quadratic, angle):
    @jax.custom_jvp
    def untouchable(x):
        return x

    @untouchable.defjvp
    def _(primals, tangents):
        raise AssertionError("differentiated")

    class Guarded(eqx.Module):
        inner: eqx.Module

        def objective(self, start=None):
            return eqx.tree_at(lambda p: p.weight, self.inner, untouchable(self.inner.weight)).objective(start)

    problem = Guarded(make_quadratic())
    fit(problem, optax.sgd(0.1), steps=2, where=lambda p: p.inner.actuation.angle)
    with pytest.raises(AssertionError, match="differentiated"):
        fit(problem, optax.sgd(0.1), steps=2, where=lambda p: p.inner.weight)


def test_the_actuation_is_trained_by_default(make_quadratic):
    problem = make_quadratic(start=0.5)
    result = fit(problem, optax.sgd(0.01), steps=3).problem
    assert not np.allclose(result.actuation.angle, problem.actuation.angle)
    assert not np.allclose(result.actuation.stretch, problem.actuation.stretch)
    assert eqx.tree_equal(result.weight, problem.weight)


def test_parts_of_a_design_can_have_optimisers_of_their_own(make_quadratic):
    labels = {"actuation.angle": "moves", "weight": "stays"}
    optimiser = optax.multi_transform({"moves": optax.sgd(0.1), "stays": optax.set_to_zero()}, labels)
    problem = make_quadratic()
    result = fit(problem, optimiser, steps=3, where=lambda p: (p.actuation.angle, p.weight)).problem
    assert eqx.tree_equal(result.weight, problem.weight) and not np.allclose(result.actuation.angle, 0)


def test_a_problem_without_a_shape(make_quadratic, angle):
    class Flat(eqx.Module):
        actuation: eqx.Module

        def objective(self, start=None):
            loss = jnp.sum(self.actuation.angle**2)
            return loss, ({"Flat": loss}, None)

    result = fit(Flat(make_quadratic(start=1.0).actuation), optax.sgd(0.1), steps=4, where=angle)
    np.testing.assert_allclose(result.history["Flat"], [3 * 0.8 ** (2 * k) for k in range(4)])
    assert "solver_steps" not in result.history


@pytest.mark.parametrize("make", [lambda: optax.adam(optax.cosine_decay_schedule(0.1, 9)), optax.lbfgs])
def test_a_fit_compiles_once_and_the_next_one_not_at_all(make_quadratic, angle, caplog, make):
    traces, optimiser = [], make()
    jax.clear_caches()

    def compiled(problem, steps):
        caplog.clear()
        with jax.log_compiles(), caplog.at_level(logging.WARNING):
            fit(problem, optimiser, steps=steps, where=angle)
        return " ".join(r.getMessage() for r in caplog.records if "Finished XLA compilation" in r.getMessage())

    trace = lambda: traces.append(1)
    first = compiled(make_quadratic(traced=trace), 6)
    assert [first.count(f"jit({name})") for name in ("_evaluate", "advance", "move")] == [1, 1, 1]
    count = len(traces)
    assert not compiled(make_quadratic(start=0.3, traced=trace), 8)
    assert len(traces) == count


def test_callbacks_see_each_step_and_may_stop(make_quadratic, angle):
    seen = []

    def callback(info):
        seen.append((info.step, info.loss, info.terms["Distance"], info.history["loss"][-1]))
        np.testing.assert_array_equal(info.equilibrium.vertices, info.problem.actuation.angle)
        return info.step == 4

    result = fit(make_quadratic(), optax.adam(0.1), steps=50, where=angle, callbacks=[callback])
    assert [step for step, *_ in seen] == list(range(5))
    assert [loss for _, loss, *_ in seen] == [last for *_, last in seen] == list(result.history["loss"])
    assert result.stopped == "callback" and result.history.steps == 5


def test_stops_on_a_plateau(make_quadratic, angle):
    result = fit(make_quadratic(), optax.sgd(0.2), steps=500, where=angle, callbacks=[Stop(patience=5, tolerance=1e-3)])
    loss = result.history["loss"]
    assert result.stopped == "plateau" and len(loss) < 60
    assert loss[-5:].min() >= loss[:-5].min() * (1 - 1e-3)
    assert loss[-6:-1].min() < loss[:-6].min() * (1 - 1e-3)


def test_stops_when_time_is_over(make_quadratic, angle):
    result = fit(make_quadratic(), optax.sgd(0.2), steps=10**6, where=angle, callbacks=[Stop(seconds=1e-9)])
    assert result.stopped == "seconds" and result.history.steps == 1


def test_ctrl_c_returns_what_there_is(make_quadratic, angle):
    def callback(info):
        if info.step == 3:
            raise KeyboardInterrupt

    result = fit(make_quadratic(), optax.sgd(0.1), steps=9, where=angle, callbacks=[callback])
    assert result.stopped == "interrupted" and result.history.steps == 3
    assert result.best_loss == result.history["loss"][-1]


@pytest.mark.parametrize(
    ("where", "message"),
    [
        (lambda p: p.count, "count, an array of int"),
        (lambda p: p.kind, "'plain', which is no array"),
        (lambda p: (p.weight, None), "item 1 is None"),
        (lambda p: (), "picked nothing"),
        (lambda p: (p.weight, p.weight), "weight twice"),
        (lambda p: p.actuation.angles, "only pick parts.*AttributeError"),
        (lambda p: p.actuation.angle + 1, "item 0 is a new array of shape .*, which is no array of the problem"),
    ],
)
def test_where_must_pick_trainable_arrays(make_quadratic, where, message):
    with pytest.raises(ValueError, match=message):
        fit(make_quadratic(), optax.sgd(0.1), steps=1, where=where)


class Pattern(eqx.Module):
    """An actuation that a network writes, with what else networks are made of."""

    network: eqx.nn.MLP
    rounds: jax.Array
    scale: float = 2.0


def with_network(make_quadratic):
    network = eqx.nn.MLP(2, 3, width_size=4, depth=1, key=jax.random.key(0))
    return eqx.tree_at(lambda p: p.actuation, make_quadratic(), Pattern(network, jnp.arange(3)))


@pytest.mark.parametrize(
    "where",
    [
        lambda p: p.actuation,
        lambda p: p.actuation.network,
        lambda p: (p.actuation.network.layers[0], [p.actuation.network.layers[1]]),
        lambda p: jax.tree.leaves(eqx.filter(p.actuation.network, eqx.is_array)),
        lambda p: eqx.filter(p.actuation, eqx.is_inexact_array),
    ],
)
def test_where_may_pick_a_part(make_quadratic, where):
    """Of a network its weights are trained; its activation function and integers are left alone."""
    names = selected(with_network(make_quadratic), where, "where")
    layers = [f"actuation.network.layers.{k}.{part}" for k in (0, 1) for part in ("weight", "bias")]
    assert names == layers


@pytest.mark.parametrize(
    ("where", "message"),
    [
        (lambda p: p.actuation.network.activation, "actuation.network.activation, a .*: only floating-point"),
        (
            lambda p: eqx.filter(p.actuation, lambda leaf: False),
            "Pattern, holds no floating-point array.*nothing",
        ),
        (lambda p: [], "picked nothing.*There are .*actuation.network.layers.0.weight"),
    ],
)
def test_where_says_what_there_was(make_quadratic, where, message):
    with pytest.raises(ValueError, match=message):
        selected(with_network(make_quadratic), where, "where")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Stop(patience=0), "patience must be a whole number, at least 1; got 0"),
        (lambda: Stop(tolerance=-1.0), "tolerance must not be negative"),
        (lambda: Stop(seconds=0.0), "seconds must be positive"),
        (lambda: Checkpoint("run", every=0), "every must be a whole number"),
        (lambda: WarmStart(check_every=0), "check_every must be a whole number"),
        (lambda: Refuse(most=-1), "most must be a whole number, at least 0"),
        (lambda: Refuse(rise=-0.1), "rise must not be negative"),
    ],
)
def test_choices_out_of_range(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_what_cannot_be_fitted(make_quadratic, angle):
    with pytest.raises(ValueError, match="steps must be a whole number, at least 1; got 0"):
        fit(make_quadratic(), optax.sgd(0.1), where=angle, steps=0)


def test_a_fit_has_ten_arguments_at_most():
    assert len(inspect.signature(fit).parameters) <= 10


def test_no_actuation_to_train(make_quadratic):
    class Passive(eqx.Module):
        pass

    problem = eqx.tree_at(lambda p: p.actuation, make_quadratic(), Passive())
    with pytest.raises(ValueError, match="Passive has none"):
        fit(problem, optax.sgd(0.1), steps=1)


def test_a_term_named_as_a_column(angle, make_quadratic):
    class Clash(eqx.Module):
        actuation: eqx.Module

        def objective(self, start=None):
            return jnp.sum(self.actuation.angle), ({"seconds": jnp.zeros(())}, None)

    with pytest.raises(ValueError, match="'seconds'"):
        fit(Clash(make_quadratic().actuation), optax.sgd(0.1), steps=1, where=angle)
