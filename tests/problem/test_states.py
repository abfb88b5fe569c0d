"""One design in several states: what is shared is one array, and all that is asked of the states is asked of each."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import optimistix as optx
import pytest

import shellkit as sk


MESH = sk.meshes.icosphere(0)
MATERIAL = sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0)
ANGLES = jnp.linspace(0.1, 1.0, MESH.n_faces)
TARGET = sk.VertexDistance(MESH.vertices * jnp.array([0.9, 0.9, 1.2]), aligner=sk.Kabsch())
angle = lambda p: p.actuation.angle


def shell(stretch, angles=ANGLES, loss=TARGET):
    return sk.InverseProblem(MESH, 0.2, MATERIAL, sk.Nematic(angles, stretch), loss)


@pytest.fixture(scope="module")
def states():
    return sk.States({"warm": shell(1.05), "hot": shell(1.2)}, shared=angle, weights={"hot": 2.0})


def test_shared_arrays_are_stored_once(states):
    arrays = [leaf for leaf in jax.tree.leaves(states) if eqx.is_array(leaf) and leaf.shape == ANGLES.shape]
    held = [leaf for leaf in arrays if np.array_equal(leaf, ANGLES)]
    assert len(held) == 1
    assert states["warm"].actuation.angle is states["hot"].actuation.angle
    turned = eqx.tree_at(angle, states, ANGLES + 1)
    assert np.array_equal(turned["hot"].actuation.angle, ANGLES + 1)
    assert float(turned["hot"].actuation.stretch) == 1.2


def test_loss_is_the_weighted_sum(states):
    value, terms = states.evaluate()
    alone = {name: float(shell(stretch).evaluate()[0]) for name, stretch in (("warm", 1.05), ("hot", 1.2))}
    assert {name: float(term) for name, term in terms.items()} == pytest.approx(
        {f"{name}.VertexDistance": loss for name, loss in alone.items()}, rel=1e-12
    )
    assert float(value) == pytest.approx(alone["warm"] + 2 * alone["hot"], rel=1e-12)


def test_gradient_adds_up(states):
    loss = lambda angles, of: eqx.tree_at(angle, of, angles).evaluate()[0]
    together = jax.grad(loss)(ANGLES, states)
    alone = [jax.grad(loss)(ANGLES, shell(stretch)) for stretch in (1.05, 1.2)]
    assert np.allclose(together, alone[0] + 2 * alone[1], rtol=1e-10, atol=1e-14)


def test_residuals_are_those_of_all_states(states):
    equilibria = states()
    value, _ = states.evaluate()
    assert float(jnp.sum(states.residuals(equilibria) ** 2)) == pytest.approx(float(value), rel=1e-10)


def test_states_of_one_kind_relax_by_one_program(states, monkeypatch):
    import shellkit._relaxation.forward as forward

    states()
    traced = []
    minimised = forward.minimised
    monkeypatch.setattr(forward, "minimised", lambda *parts: traced.append(1) or minimised(*parts))
    sk.States({"cool": shell(0.97), "cold": shell(0.9), "colder": shell(0.85)}, shared=angle)()
    assert traced == []


def test_what_is_said_of_all(states):
    found = states()
    assert list(found) == ["warm", "hot"] and len(found) == 2 and dict(found.items()).keys() == found.keys()
    assert int(found.steps) == sum(int(each.steps) for each in found.values())
    assert bool(found.converged) and bool(found.stable) and found.result == sk.RESULTS.successful
    starved = sk.States({"one": shell(1.2).replace(max_steps=1), "two": shell(1.05)}, shared=angle)()
    assert not bool(starved.converged) and starved.result == sk.RESULTS.nonlinear_max_steps_reached


def test_a_state_starts_from_another():
    """Relaxed from the very same shape, nothing is left to do."""
    states = sk.States({"again": shell(1.2), "hot": shell(1.2)}, shared=angle, after={"again": "hot"})
    found = states()
    assert int(found["again"].steps) <= 2 < int(found["hot"].steps)
    value, _ = states.evaluate()
    assert float(value) == pytest.approx(2 * float(shell(1.2).evaluate()[0]), rel=1e-9)


@pytest.mark.parametrize("method", [optax.adam(0.05), optx.LevenbergMarquardt(1e-9, 1e-12)], ids=["adam", "squares"])
def test_trained_together(states, method):
    result = sk.fit(states, method, steps=3, where=angle, progress=False)
    assert {"warm.VertexDistance", "hot.VertexDistance"} <= set(result.history.keys())
    assert result.best_loss < float(states.evaluate()[0])
    assert np.array_equal(result.problem["warm"].actuation.angle, result.problem["hot"].actuation.angle)
    assert set(result.problem()) == {"warm", "hot"}


def test_a_fit_goes_on_from_its_checkpoint(states, tmp_path):
    optimiser = optax.adam(0.05)
    whole = sk.fit(states, optimiser, steps=4, where=angle, progress=False)
    sk.fit(states, optimiser, steps=2, where=angle, progress=False, checkpoint=tmp_path / "run")
    resumed = sk.fit(states, optimiser, steps=4, where=angle, progress=False, checkpoint=tmp_path / "run")
    assert resumed.best_loss == whole.best_loss


def test_many_fits_of_states(states):
    other = eqx.tree_at(angle, states, ANGLES + 0.3)
    many = sk.fit_many([states, other], optax.adam(0.05), steps=2, where=angle)
    assert not many.failures and np.all(np.isfinite(many.losses))


def test_derivative_by_taylor(states):
    report = sk.taylor_test(states, where=angle)
    assert float(report.error) < 1e-6 and abs(float(report.slopes[0]) - 2) < 0.1


def test_more_states_tell_more(states):
    """Of the spectra of each state, their squares added up: the singular values of a stack are between those bounds."""
    one = sk.identifiability(shell(1.05), where=angle)
    both = sk.identifiability(sk.States({"a": shell(1.05), "b": shell(1.05)}, shared=angle), where=angle)
    # The same state twice: the mean square over all vertices is that of one.
    assert np.allclose(both.singular_values, one.singular_values, rtol=1e-8, atol=1e-12)
    differing = sk.identifiability(states, where=angle)
    assert differing.rank(1e-6) >= one.rank(1e-6)
    assert differing.shapes.shape[1] == 2 * MESH.n_vertices


def test_wrong_states_are_refused():
    with pytest.raises(ValueError, match=r"actuation\.angle is to be shared, but differs between 'a' and 'b'"):
        sk.States({"a": shell(1.1), "b": shell(1.1, ANGLES + 1)}, shared=angle)
    with pytest.raises(ValueError, match="weights names 'c', which is none of a"):
        sk.States({"a": shell(1.1)}, shared=angle, weights={"c": 1.0})
    with pytest.raises(ValueError, match="there are no states"):
        sk.States({}, shared=angle)
    with pytest.raises(ValueError, match="'a' is a Mesh"):
        sk.States({"a": MESH}, shared=angle)
    with pytest.raises(ValueError, match="a and b would each have to come after the other"):
        sk.States({"a": shell(1.1), "b": shell(1.2)}, shared=angle, after={"a": "b", "b": "a"})
    growth = sk.InverseProblem(MESH, 0.2, MATERIAL, sk.IsotropicGrowth(1.1), TARGET)
    with pytest.raises(ValueError, match=r"'b' has no array actuation\.angle"):
        sk.States({"a": shell(1.1), "b": growth}, shared=angle)
    states = sk.States({"a": shell(1.1)}, shared=angle)
    with pytest.raises(KeyError, match="no state 'b'; there are a"):
        states["b"]
    with pytest.raises(ValueError, match="item 0 is None"):
        sk.fit(states, optax.adam(0.1), steps=1, where=lambda p: p.actuation.stretch, progress=False)
