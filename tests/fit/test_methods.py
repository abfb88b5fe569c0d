"""Methods of a user's own: what they have to say, and that all else of a fit works with them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

import shellkit as sk
from shellkit._fit.fit import as_method


class HeavyBall(sk.Method):
    """Polyak's method."""

    rate: float
    momentum: float = 0.5

    def init(self, objective, variables):
        return jax.tree.map(jnp.zeros_like, variables)

    def update(self, objective, found, state):
        velocity = jax.tree.map(lambda v, g: self.momentum * v - self.rate * g, state, found.gradient)
        return velocity, velocity


class RandomSearch(sk.Method):
    """Random steps, of which those that lower the loss are kept."""

    size: float
    needs_gradient = False

    def init(self, objective, variables):
        return jax.random.key(3), jnp.asarray(jnp.inf)

    def accept(self, objective, found, course):
        key, best = course.state
        return sk.Accepted(found, (key, found.loss), {"size": self.size}) if found.loss < best else None

    def refuse(self, course):
        update, state = self.draw(course.anchor, course.state)
        return course._replace(update=update, state=state)

    def update(self, objective, found, state):
        return self.draw(found.free, state)

    def draw(self, like, state):
        key, sub = jax.random.split(state[0])
        return {name: self.size * jax.random.normal(sub, x.shape) for name, x in like.items()}, (key, state[1])


BALL = HeavyBall(rate=0.1)


def recursion(n, steps):
    """The loss of the heavy ball on Σ (x - t)² + 0.01 x², t = 1 … n, from 0."""
    x, v, t, losses = np.zeros(n), np.zeros(n), np.arange(1.0, n + 1), []
    for _ in range(steps):
        losses.append(np.sum((x - t) ** 2 + 0.01 * x**2))
        v = 0.5 * v - 0.1 * (2 * (x - t) + 0.02 * x)
        x = x + v
    return losses


def test_a_method_of_ones_own(make_quadratic, angle, tmp_path):
    result = sk.fit(make_quadratic(), BALL, steps=20, where=angle)
    np.testing.assert_allclose(result.history["loss"], recursion(3, 20), rtol=1e-12)
    assert (result.history["update_scale"] == 1).all()
    sk.fit(make_quadratic(), BALL, steps=7, where=angle, checkpoint=tmp_path / "run")
    resumed = sk.fit(make_quadratic(), BALL, steps=20, where=angle, checkpoint=tmp_path / "run")
    np.testing.assert_array_equal(resumed.history["loss"], result.history["loss"])
    # Its state has the shapes of another method's, whose checkpoint it is not.
    with pytest.raises(ValueError, match=r"choices\.solver: HeavyBall in the checkpoint, absent here"):
        sk.fit(make_quadratic(), optax.trace(0.5), steps=20, where=angle, checkpoint=tmp_path / "run")


def test_its_refused_steps_are_halved(make_quadratic, angle):
    problem = make_quadratic(1, limit=jnp.asarray(0.15))
    with pytest.warns(UserWarning, match="step 1 was refused"):
        history = sk.fit(problem, BALL, steps=2, where=angle).history
    # From 0 the first step, 0.2, goes beyond the limit; half of it does not.
    assert list(history["refused"]) == [0, 1] and list(history["update_scale"]) == [1, 0.5]
    np.testing.assert_allclose(history["loss"][1], 0.9**2 + 0.01 * 0.1**2)


@pytest.mark.parametrize("how", ["map", "vmap"])
def test_many_with_ones_own(make_quadratic, angle, how):
    problems = [make_quadratic(2), make_quadratic(2, start=0.3)]
    many = sk.fit_many(problems, BALL, steps=6, where=angle, together=how)
    np.testing.assert_allclose(many.results[0].history["loss"], recursion(2, 6), rtol=1e-12)
    alone = sk.fit(problems[1], BALL, steps=6, where=angle)
    np.testing.assert_allclose(many.results[1].history["loss"], alone.history["loss"], rtol=1e-12)
    with pytest.raises(ValueError, match="take every design; got RandomSearch"):
        sk.fit_many(problems, RandomSearch(0.1), steps=6, where=angle, together=how)


class Rough(eqx.Module):
    """A problem of whose loss no gradient can be taken."""

    inner: eqx.Module

    def objective(self, start=None):
        loss, found = self.inner.objective(start)
        return jax.pure_callback(lambda x: x, jax.ShapeDtypeStruct((), float), loss), found


def test_a_method_without_gradients(make_quadratic, tmp_path):
    def run(steps, **options):
        where, refuse = lambda p: p.inner.actuation.angle, sk.Refuse(most=50)
        return sk.fit(Rough(make_quadratic(2)), RandomSearch(0.1), steps=steps, where=where, refuse=refuse, **options)

    result = run(15)
    assert (np.diff(result.history["loss"]) < 0).all() and result.history["refused"].sum() > 0
    assert "gradient_norm" not in result.history and (result.history["size"] == 0.1).all()
    run(6, checkpoint=tmp_path / "run")
    np.testing.assert_array_equal(run(15, checkpoint=tmp_path / "run").history["loss"], result.history["loss"])


def test_what_is_no_method():
    with pytest.raises(ValueError, match=r"method must be an optimiser of optax.*got 0\.1"):
        as_method(0.1, stacklevel=1)
