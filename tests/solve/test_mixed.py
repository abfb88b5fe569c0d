"""Steps with strains as unknowns of their own, on a function small enough to be written out: a mass on a stiff string,
pushed round a circle."""

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

import shellkit as sk
from shellkit._solve.matrices.pattern import SymmetricPattern
from shellkit._solve.newton.mixed import MixedState
from shellkit._solve.newton.points import Point, Reached, Step


PATTERN, POSITIONS = SymmetricPattern.of(np.array([0, 0, 1]), np.array([0, 1, 1]), 2)
START, END = jnp.array([0.0, 1.0]), np.array([0.7, np.sqrt(0.51)])


def string(stiffness, apart=True, solver=sk.SparseNewton(), **limits):
    """The minimum of stiffness/2 (|y|² - 1)² + y₀²/2 - 0.7 y₀, which is on the circle."""
    strain = lambda y: y @ y - 1
    soft = lambda y: 0.5 * y[0] ** 2 - 0.7 * y[0]
    value = lambda y: 0.5 * stiffness * strain(y) ** 2 + soft(y)

    def matrix(y, stress):
        dense = 4 * stiffness * jnp.outer(y, y) + 2 * stress * jnp.eye(2) + jnp.diag(jnp.array([1.0, 0.0]))
        upper = dense[jnp.array([0, 0, 1]), jnp.array([0, 1, 1])]
        return sk.SparseSymmetric(PATTERN, jnp.zeros(3).at[POSITIONS].set(upper))

    def derivatives(y, strains, at_strains):
        stress = stiffness * strain(y)
        gradient = 2 * stress * y + jax.grad(soft)(y)
        hessian = matrix(y, jnp.where(at_strains, strains[1], stress))
        ahead = lambda step: (strain(y) + 2 * y @ step, stress + stiffness * 2 * y @ step)
        return value(y), gradient, hessian, None, ahead

    options = {"derivatives": lambda y: derivatives(y, (0.0, 0.0), False)[:4]}
    if apart:
        options["apart"] = (lambda y: (strain(y), jnp.zeros(())), derivatives)
    found = optx.minimise(lambda y, _: value(y), solver, START, options=options, throw=False, **limits)
    return found, float(value(found.value) - value(START))


def test_steps_do_not_depend_on_the_stiffness():
    steps = []
    for stiffness in (1e0, 1e2, 1e6, 1e10):
        found, _ = string(stiffness)
        assert found.result == optx.RESULTS.successful
        assert np.allclose(found.value, END, atol=1e-9)
        steps.append(int(found.stats["num_steps"]))
    assert max(steps) <= 3 * min(steps)
    # In the positions alone they do.
    alone = string(1e6, apart=False)[0]
    assert int(alone.stats["num_steps"]) > 3 * max(steps)
    # As where the part is left out, or sees no valley as narrow.
    for absent in (None, sk.MixedSteps(narrow=0.0)):
        found, _ = string(1e6, solver=sk.SparseNewton(mixed_steps=absent))
        np.testing.assert_array_equal(found.value, alone.value)
        assert int(found.stats["num_steps"]) == int(alone.stats["num_steps"])


def after(length=0.125, size=0.5, direction=(1.0, 0.0), trusted=True, on=False, steps=0, attempts=0, value=1.0):
    """What follows on a step of some length from (1, 1), by which the energy fell from 2; of mixed ones before it the
    origin is (0, 0), at 1.5."""
    numbers = lambda *values: [jnp.asarray(v) for v in values]
    start = Point.of(jnp.ones(2), jnp.asarray(2.0), jnp.ones(2))
    origin = Point.of(jnp.zeros(2), jnp.asarray(1.5), jnp.ones(2))
    direction = jnp.asarray(direction)
    moved = Point.of(start.y + length * direction, jnp.asarray(value), jnp.ones(2))
    state = MixedState(jnp.zeros(2), *numbers(on), origin, *numbers(steps, attempts))
    step = Step(start, direction, *numbers(size, -1.0, True, False, on))
    reached = Reached(moved, *numbers(float(length), False))
    ahead = lambda direction: 7 * direction
    return sk.MixedSteps().after(state, step, reached, *numbers(trusted, 1.0), ahead)


def test_they_begin_with_a_step_that_had_to_be_cut():
    state, point = after()
    assert state.on and int(state.attempts) == 1
    np.testing.assert_array_equal(state.strains, [7, 0])
    # It goes on from where the whole step leads; what it may come back to is where the part that was taken does.
    np.testing.assert_array_equal(point.y, [2, 1])
    np.testing.assert_array_equal(state.origin.y, [1.125, 1])
    for other in ({"length": 0.25}, {"length": 0.0}, {"size": 1e-4}, {"trusted": False}, {"attempts": 3}):
        state, point = after(**other)
        assert not state.on and int(state.attempts) == other.get("attempts", 0)
        np.testing.assert_array_equal(point.y, [1 + other.get("length", 0.125), 1])


def test_they_go_on_while_they_are_sound_and_end_where_they_began_if_in_vain():
    state, point = after(on=True, length=1.0, steps=3, value=100.0)
    assert state.on and int(state.steps) == 4
    np.testing.assert_array_equal(point.y, [2, 1])
    for vain in ({"trusted": False}, {"size": 1e4}, {"steps": 15}, {"value": np.inf}, {"size": 1e-7, "value": 1.6}):
        state, point = after(**({"on": True, "length": 1.0} | vain))
        assert not state.on
        np.testing.assert_array_equal(point.y, [0, 0])
    # Arrived lower than at the origin, they are over, and not in vain.
    state, point = after(on=True, length=1.0, size=1e-7, value=1.4)
    assert not state.on
    np.testing.assert_array_equal(point.y, [2, 1])


@pytest.mark.parametrize("max_steps", [2, 4])
def test_cut_short_it_is_no_higher_than_at_the_start(max_steps):
    """In the midst of such steps the energy is far above; what is returned is where they began."""
    found, rise = string(1e6, max_steps=max_steps)
    assert rise <= 0
    assert found.result != optx.RESULTS.successful
