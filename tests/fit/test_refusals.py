"""Designs whose loss is NaN or whose relaxation fails: refused, reported, and never the end of a good design."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from shellkit._fit.choices import Refuse
from shellkit._fit.fit import fit


def test_a_failed_relaxation_is_retried_with_half_the_update(make_quadratic, angle):
    # From 0 the first update goes to 0.8, beyond the limit; half of it, 0.4, is accepted.
    problem = make_quadratic(1, limit=jnp.asarray(0.5), weight=jnp.full(1, 0.99))
    with pytest.warns(UserWarning, match="step 1 was refused, as the relaxation did not converge.*stand-in"):
        result = fit(problem, optax.sgd(0.8 / 1.98), steps=2, where=angle)
    np.testing.assert_allclose(result.last_problem.actuation.angle, 0.4)
    np.testing.assert_array_equal(result.history["refused"], [0, 1])
    np.testing.assert_array_equal(result.history["update_scale"], [1, 0.5])
    assert result.history["converged"].all()


def test_the_scale_grows_back(make_quadratic, angle):
    problem = make_quadratic(1, limit=jnp.asarray(0.3))
    optimiser = optax.sgd(lambda step: jnp.where(step == 0, 1.0, 1e-3))
    with pytest.warns(UserWarning, match="refused"):
        history = fit(problem, optimiser, steps=6, where=angle).history
    # 2.0 is refused, then 1.0, 0.5; 0.25 is accepted at an eighth, and the scale doubles from there.
    np.testing.assert_array_equal(history["refused"], [0, 3, 0, 0, 0, 0])
    np.testing.assert_array_equal(history["update_scale"], [1, 1 / 8, 1 / 4, 1 / 2, 1, 1])


def test_the_optimiser_never_sees_a_nan(make_quadratic, angle):
    problem = make_quadratic(1, cliff=jnp.asarray(0.5))
    with pytest.warns(UserWarning, match="step 1 was refused, as the loss is nan"):
        result = fit(problem, optax.adam(0.8), steps=3, where=angle)
    assert np.isfinite(result.history["loss"]).all() and result.history["refused"][1] == 1
    assert all(np.isfinite(np.asarray(leaf)).all() for leaf in jax.tree.leaves(result.state))


def test_too_many_refusals_stop_the_fit_and_keep_the_best(make_quadratic, angle):
    problem = make_quadratic(1, limit=jnp.asarray(0.0))
    with pytest.warns(UserWarning) as caught:
        result = fit(problem, optax.sgd(0.1), steps=50, where=angle, refuse=Refuse(most=3))
    assert [str(w.message).split(";")[0] for w in caught][1].endswith("as 4 designs in a row were refused")
    assert result.stopped == "refused" and result.history.steps == 1
    np.testing.assert_array_equal(result.problem.actuation.angle, problem.actuation.angle)
    assert result.best_loss == 1.0


def test_unconverged_designs_can_be_accepted(make_quadratic, angle):
    problem = make_quadratic(1, limit=jnp.asarray(0.3))
    result = fit(problem, optax.sgd(0.4), steps=20, where=angle, refuse=Refuse(unconverged=False))
    np.testing.assert_allclose(result.problem.actuation.angle, 1 / 1.01)
    assert not result.history["converged"][1:].any() and (result.history["refused"] == 0).all()


def test_the_start_must_be_acceptable(make_quadratic, angle, tmp_path):
    with pytest.raises(ValueError, match=r"fit cannot begin.*did not converge"):
        problem = make_quadratic(start=1.0, limit=jnp.asarray(0.0))
        fit(problem, optax.sgd(0.1), steps=5, where=angle, checkpoint=tmp_path / "run")
    assert not list(tmp_path.iterdir())  # or the next start would be taken for another problem
    with pytest.raises(ValueError, match=r"fit cannot begin.*the loss is nan"):
        fit(make_quadratic(start=1.0, cliff=jnp.asarray(0.0)), optax.sgd(0.1), steps=5, where=angle)


def test_a_gradient_that_is_not_finite_is_named(make_quadratic, angle):
    class Root(eqx.Module):
        actuation: eqx.Module

        def objective(self, start=None):
            loss = jnp.sqrt(jnp.sum(self.actuation.angle**2))  # 0 at 0, where it has no derivative
            return loss, ({"Root": loss}, None)

    with pytest.raises(ValueError, match=r"the gradient is not finite in actuation\.angle"):
        fit(Root(make_quadratic().actuation), optax.sgd(0.1), steps=1, where=angle)
