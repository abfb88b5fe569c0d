"""The Taylor test, on a derivative that is right, and on ones that are wrong by known amounts."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

import shellkit as sk


MESH = sk.meshes.icosphere(subdivisions=1)


@jax.custom_jvp
def with_wrong_derivative(value, excess):
    return value


@with_wrong_derivative.defjvp
def _(primals, tangents):
    (value, excess), (tangent, _) = primals, tangents
    return value, (1 + excess) * tangent


class Height(sk.Loss):
    """How far a shell spreads along z, squared, with a derivative that is too large by a fraction."""

    excess: Array
    curved: Array

    def __call__(self, equilibrium, actuation):
        spread = jnp.sum(equilibrium.vertices[:, 2] ** 2)
        return with_wrong_derivative(spread + self.curved * spread**2, self.excess)

    @property
    def sees_motion(self):
        return True


@pytest.fixture(scope="module")
def problem():
    rng = np.random.default_rng(0)
    return sk.InverseProblem(
        mesh=MESH,
        thickness=0.1,
        actuation=sk.Nematic(angle=jnp.asarray(rng.normal(size=MESH.n_faces)), stretch=1.05),
        energy=sk.StVenantKirchhoff(alpha=1.0, beta=1.0),
        loss=Height(jnp.asarray(0.0), jnp.asarray(0.1)),
    )


@pytest.fixture(scope="module")
def report(problem):
    return sk.taylor_test(problem)


def test_a_right_derivative_passes(report):
    assert report.passed and report.converged
    assert report.slopes.shape == (4,) and (np.asarray(report.slopes) > 1.95).all()
    assert report.error < 1e-7 and report.tangent_error < 1e-11


def test_remainders_are_above_the_noise_and_steps_are_halves(report):
    np.testing.assert_allclose(report.steps[1:], report.steps[:-1] / 2)
    assert (report.remainders > 100 * report.noise).all()


def test_a_table_of_the_remainders(report):
    assert len(str(report).splitlines()) == 9


@pytest.mark.parametrize("excess", [1e-1, 1e-3, 1e-5])
def test_a_wrong_derivative_is_caught(problem, excess):
    wrong = eqx.tree_at(lambda p: p.loss.excess, problem, jnp.asarray(excess))
    report = sk.taylor_test(wrong)
    assert not report.passed
    np.testing.assert_allclose(report.error, excess / (1 + excess), rtol=1e-2)
    assert excess < 1e-4 or (np.asarray(report.slopes) < 1.2).all()


def test_directions_differ_by_seed_and_steps_can_be_chosen(problem, report):
    other = sk.taylor_test(problem, seed=1, halvings=2, step=1e-4)
    assert other.passed and other.derivative != report.derivative
    np.testing.assert_allclose(other.steps, [1e-4, 5e-5, 2.5e-5])


def test_arrays_of_the_actuation_by_default(problem, report):
    named = sk.taylor_test(problem, where=lambda p: (p.actuation.angle, p.actuation.stretch))
    assert named.derivative == report.derivative


def test_what_cannot_be_differentiated_is_refused(problem):
    with pytest.raises(ValueError, match=r"mesh\.faces"):
        sk.taylor_test(problem, where=lambda p: p.mesh.faces)
