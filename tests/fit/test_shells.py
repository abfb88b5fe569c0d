"""Training real shells: the 42-vertex sphere of the tutorial, for a few steps."""

import logging

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

import shellkit as sk
from shellkit._fit.design import Bounds


@pytest.fixture(scope="module")
def problem():
    mesh = sk.meshes.icosphere(subdivisions=1)
    sheet = lambda: sk.Nematic(angle=jnp.zeros(mesh.n_faces), stretch=1.1)
    return sk.InverseProblem(
        mesh=mesh,
        thickness=0.1,
        actuation=sk.Bilayer(top=sheet(), bottom=sheet()),
        energy=sk.StVenantKirchhoff(alpha=1.0, beta=1.0) + sk.Bending(alpha=1.0, beta=1.0),
        loss=sk.VertexDistance(mesh.vertices * jnp.array([0.95, 0.95, 1.2]), aligner=sk.Kabsch())
        + 1e-3 * sk.DirectorSmoothness(),
    )


ADAM = optax.adam(0.1)
angles = lambda p: (p.actuation.top.angle, p.actuation.bottom.angle)


@pytest.fixture(scope="module")
def straight(problem):
    return sk.fit(problem, ADAM, steps=12, where=angles)


@pytest.mark.slow
def test_the_same_as_a_loop_of_ones_own(problem, straight):
    spec = eqx.tree_at(angles, jax.tree.map(lambda _: False, problem), replace=(True, True))
    trained, frozen = eqx.partition(problem, spec)
    step = eqx.filter_jit(eqx.filter_value_and_grad(lambda t: eqx.combine(t, frozen).evaluate()[0]))
    state, losses = ADAM.init(trained), []
    for _ in range(4):
        loss, gradient = step(trained)
        losses.append(float(loss))
        with jax.numpy_dtype_promotion("standard"):  # optax mixes counts and rates
            updates, state = ADAM.update(gradient, state)
        trained = eqx.apply_updates(trained, updates)
    np.testing.assert_allclose(straight.history["loss"][:4], losses, rtol=1e-6)


def test_what_is_recorded(problem, straight):
    history = straight.history
    assert {"loss", "VertexDistance", "DirectorSmoothness"} <= set(history)
    np.testing.assert_allclose(
        history["loss"], history["VertexDistance"] + 1e-3 * history["DirectorSmoothness"], rtol=1e-12
    )
    assert history["converged"].all() and history["stable"].all() and (history["solver_steps"] > 0).all()
    assert (history["relaxation_gradient_norm"] < 1e-8).all()
    again = sk.fit(straight.problem, ADAM, steps=1, where=angles)
    assert again.history["loss"][0] == pytest.approx(straight.best_loss, rel=1e-9)
    assert straight.best_loss < history["loss"][0]
    assert eqx.tree_equal(straight.problem.actuation.top.stretch, problem.actuation.top.stretch)


def test_resumes(problem, straight, tmp_path):
    for steps in (5, 12):
        resumed = sk.fit(problem, ADAM, steps=steps, where=angles, checkpoint=tmp_path / "run")
    np.testing.assert_allclose(resumed.history["loss"], straight.history["loss"], rtol=1e-9)
    assert sk.load_checkpoint(tmp_path / "run", problem).best_loss == resumed.best_loss
    other = eqx.tree_at(lambda p: p.mesh.vertices, problem, 1.001 * problem.mesh.vertices)
    with pytest.raises(ValueError, match=r"problem\.mesh\.vertices"):
        sk.load_checkpoint(tmp_path / "run", other)


def test_warm_starts_save_steps_and_change_nothing(problem):
    # Plain descent: ADAM divides by gradients that are zero by symmetry, and so amplifies rounding.
    run = lambda warm: sk.fit(problem, optax.sgd(20.0), steps=8, where=angles, warm_start=warm).history
    rest, last, predicted = run(None), *(run(sk.WarmStart(guess, check_every=3)) for guess in ("last", "predicted"))
    for warm in last, predicted:
        np.testing.assert_allclose(warm["loss"], rest["loss"], rtol=1e-9)
        np.testing.assert_allclose(warm["warm_gap"][[3, 6]], 0, atol=1e-12)
        assert warm["solver_steps"][1:].sum() < rest["solver_steps"][1:].sum()
    assert predicted["solver_steps"].sum() <= last["solver_steps"].sum()


def test_new_angles_compile_nothing(problem, straight, caplog):
    moved = eqx.tree_at(angles, problem, replace_fn=lambda angle: angle + 0.1)
    with jax.log_compiles(), caplog.at_level(logging.WARNING):
        sk.fit(moved, ADAM, steps=3, where=angles)
    assert not [r for r in caplog.records if "Finished XLA compilation" in r.getMessage()]


@pytest.mark.slow
def test_lbfgs(problem):
    result = sk.fit(problem, optax.lbfgs(), steps=12, where=angles)
    assert (np.diff(result.history["loss"]) < 0).all()
    assert result.best_loss < 0.5 * result.history["loss"][0]


@pytest.mark.slow
def test_stretch_within_bounds(problem):
    stretch = lambda p: p.actuation.top.stretch
    result = sk.fit(problem, ADAM, steps=6, where=stretch, bounds=[Bounds(stretch, 1.05, 1.15)])
    assert 1.05 < float(result.problem.actuation.top.stretch) < 1.15
    assert result.best_loss < result.history["loss"][0]
