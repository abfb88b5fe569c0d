"""How far a step is taken: against what Armijo's rule says of a parabola, and where energies have no digits left."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk
from shellkit._solve.newton.descent import descend
from shellkit._solve.newton.objective import NewtonObjective
from shellkit._solve.newton.points import Point, Step


NO, YES = jnp.array(False), jnp.array(True)


def refused(*_):
    raise AssertionError("a search needs neither derivatives nor a factor")


def searched(value, start, direction, search=sk.LineSearch(), regular=YES, escaping=NO, mixed=NO, feasible=None):
    """Where a search along a direction ends, in one unknown of typical length 1."""
    first = value if isinstance(value, Pair) else jax.value_and_grad(lambda y: jnp.sum(value(y)))
    objective = NewtonObjective(first, refused, refused, jnp.asarray(1.0), feasible)
    y, direction = jnp.asarray([start], dtype=float), jnp.reshape(direction, 1)
    point = Point.of(y, *first(y))
    size, slope = jnp.abs(direction[0]), point.gradient @ direction
    step = Step(point, direction, size, slope, regular, escaping, mixed)
    return descend(objective, step, search, None, refused, jnp.asarray(1e-11))


class Pair:
    """A value and a gradient that need not fit each other."""

    def __init__(self, value, gradient):
        self.value, self.gradient = value, gradient

    def __call__(self, y):
        return self.value(y[0]), self.gradient(y)


@pytest.mark.parametrize("armijo", [1e-4, 0.25, 0.45])
def test_armijo_on_a_parabola(armijo):
    """½ y² from 1 along -c falls by enough if t c ≤ 2 (1 - armijo): t is the largest power of ½ that does."""
    factors = np.array([1.0, 1.3, 1.9, 10.0, 1000.0])
    search = sk.LineSearch(armijo=armijo)
    reached = jax.vmap(lambda factor: searched(lambda y: 0.5 * y**2, 1.0, -factor, search))(jnp.asarray(factors))
    halvings = [next(k for k in range(40) if factor / 2**k <= 2 * (1 - armijo)) for factor in factors]
    np.testing.assert_array_equal(reached.length, 0.5 ** np.array(halvings))
    np.testing.assert_allclose(reached.point.y[:, 0], 1 - factors * 0.5 ** np.array(halvings), rtol=1e-14)
    assert not reached.settled.any()


def test_uphill_nothing_is_taken():
    reached = searched(lambda y: 0.5 * y**2, 1.0, 0.1)
    assert reached.stalled and float(reached.point.y[0]) == 1.0


def test_steps_are_halved_until_they_are_feasible():
    reached = searched(lambda y: 0.5 * y**2, 1.0, -1.0, feasible=lambda y, new: jnp.all(new >= 0.8))
    assert float(reached.length) == 0.125
    assert float(reached.point.y[0]) == 0.875


def test_where_the_energy_is_not_finite_nothing_is_taken():
    reached = searched(lambda y: jnp.log(y), 1.0, -16.0)
    assert float(reached.length) == 1 / 32
    hopeless = searched(lambda y: jnp.where(y < 1, jnp.nan, y), 1.0, -1.0, sk.LineSearch(max_tries=5))
    assert hopeless.stalled and float(hopeless.point.y[0]) == 1.0


def test_a_step_of_a_model_that_is_too_stiff_is_doubled_while_the_energy_falls():
    """½ (1 - t/100)² falls over t = 1, 1 + 2, 1 + 2 + 4, … to 127, past its minimum, and rises over 128 more."""
    doubled = searched(lambda y: 0.5 * y**2, 1.0, -0.01, regular=NO)
    np.testing.assert_allclose(doubled.point.y, -0.27, rtol=1e-13)
    # Neither the step of the Hessian itself is, nor one that is long.
    for step in ({"direction": -0.01}, {"direction": -0.5, "regular": NO}):
        assert float(searched(lambda y: 0.5 * y**2, 1.0, **step).length) == 1.0


def test_off_a_saddle_a_step_is_doubled_though_the_energy_is_level_at_first():
    """-y²/2 + y⁴/4 from its top, where the slope is zero: lowest over 0.1 times 1, 3, 7, 15 is the third."""
    reached = searched(lambda y: -0.5 * y**2 + 0.25 * y**4, 0.0, 0.1, regular=NO, escaping=YES)
    np.testing.assert_allclose(reached.point.y, 0.7, rtol=1e-14)


def test_where_energies_are_rounding_the_gradient_decides():
    uneven = Pair(lambda y: jnp.where(y == 1, 1.0, 1.0 + 1e-15), lambda y: y)
    assert float(searched(uneven, 1.0, -0.5).length) == 1.0
    assert searched(uneven, 1.0, -0.5, sk.LineSearch(noise=0.0)).stalled
    # With a gradient that grows it is no better.
    assert searched(Pair(uneven.value, lambda y: jnp.where(y == 1, 1.0, 2.0)), 1.0, -0.5).stalled


def test_steps_of_rounding_are_told_by_their_size():
    search, unit = sk.LineSearch(floor=1e-5, short=0.2), jnp.asarray(3.0)
    told = [bool(search.floored(jnp.asarray(size), jnp.asarray(length), unit)) for size, length in CASES]
    assert told == [True, False, False]


CASES = ((2e-5, 0.0), (2e-5, 0.25), (4e-5, 0.0))  # 1e-5 of 3 is 3e-5


@pytest.mark.parametrize("absent", [{"search": None}, {"mixed": YES}])
def test_without_a_search_a_step_is_taken_in_full(absent):
    reached = searched(lambda y: 0.5 * y**2, 1.0, -10.0, **absent)
    assert float(reached.length) == 1.0 and float(reached.point.y[0]) == -9.0
    # But for where the energy is not finite.
    assert searched(lambda y: jnp.log(y), 1.0, -16.0, search=None).stalled
