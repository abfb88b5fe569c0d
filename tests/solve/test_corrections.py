"""Corrections with the factor of a step: their recursion against the dense formula, and a parabola with a wrong
factor."""

import jax
import jax.numpy as jnp
import numpy as np

import shellkit as sk
from shellkit._solve.newton.corrections import Memory
from shellkit._solve.newton.descent import descend
from shellkit._solve.newton.objective import NewtonObjective
from shellkit._solve.newton.points import Point, Step


RANDOM = np.random.default_rng(0)
N = 12
TURN = np.linalg.qr(RANDOM.normal(size=(N, N)))[0]
HESSIAN = TURN @ np.diag(np.linspace(1.0, 4.0, N)) @ TURN.T
# An inverse that is wrong by up to a third in every direction.
INVERSE = TURN @ np.diag(1 / (np.linspace(1.0, 4.0, N) * np.linspace(0.75, 1.3, N))) @ TURN.T
YES, NO = jnp.array(True), jnp.array(False)


def updated(inverse, step, change):
    """The BFGS update of an inverse Hessian: (6.17) of Nocedal and Wright."""
    rho = 1 / (step @ change)
    left = np.eye(N) - rho * np.outer(step, change)
    return left @ inverse @ left.T + rho * np.outer(step, step)


def test_the_recursion_is_the_dense_update():
    memory, inverse = Memory.blank(3, jnp.zeros(N)), INVERSE
    gradient = jnp.asarray(RANDOM.normal(size=N))
    solve = lambda rhs: jnp.asarray(INVERSE) @ rhs
    np.testing.assert_allclose(memory.direction(gradient, solve), -inverse @ gradient, rtol=1e-13)
    for step in RANDOM.normal(size=(3, N)):
        memory = memory.with_one(jnp.asarray(step), jnp.asarray(HESSIAN @ step))
        inverse = updated(inverse, step, HESSIAN @ step)
    np.testing.assert_allclose(memory.direction(gradient, solve), -inverse @ gradient, rtol=1e-11)


def test_a_memory_forgets_the_oldest_and_what_curves_the_wrong_way():
    first, second = jnp.eye(N)[0], jnp.eye(N)[1]
    memory = Memory.blank(1, first).with_one(first, 2 * first).with_one(second, 4 * second)
    halved = memory.direction(first + second, lambda rhs: rhs)
    np.testing.assert_allclose(halved, -(first + 0.25 * second), rtol=1e-15)
    backwards = Memory.blank(1, first).with_one(first, -first)
    np.testing.assert_allclose(backwards.direction(first, lambda rhs: rhs), -first, rtol=1e-15)


def corrected(corrections, target=1e-11, regular=YES, scale=1.0):
    """A step of a parabola by the wrong inverse, and its corrections; with the number of sweeps with that inverse."""
    sweeps = []

    def solve(rhs):
        jax.debug.callback(lambda: sweeps.append(1))
        return jnp.asarray(INVERSE) @ rhs

    first = lambda y: (0.5 * y @ jnp.asarray(HESSIAN) @ y, jnp.asarray(HESSIAN) @ y)
    y = scale * jnp.asarray(TURN[:, 0] + TURN[:, -1] + 0.3 * TURN[:, 5])
    point = Point.of(y, *first(y))
    direction = -jnp.asarray(INVERSE) @ point.gradient
    size, slope = jnp.max(jnp.abs(direction)), point.gradient @ direction
    step = Step(point, direction, size, slope, regular, NO, NO)
    objective = NewtonObjective(first, first, first, jnp.asarray(2.0))
    reached = descend(objective, step, sk.LineSearch(), corrections, solve, jnp.asarray(target))
    jax.effects_barrier()
    return reached, len(sweeps), y + direction


def test_a_wrong_factor_still_leads_to_the_minimum():
    reached, sweeps, _ = corrected(sk.Corrections(patience=30.0))
    assert reached.settled and float(reached.length) == 1.0
    assert float(jnp.max(jnp.abs(reached.point.y))) < 1e-11
    # Three directions of the parabola are in play. What has been learnt pays: without it each takes off a third or so.
    _, more, _ = corrected(sk.Corrections(patience=30.0, memory=1))
    assert sweeps < more


def test_corrections_end_where_they_do_not_pay():
    _, sweeps, _ = corrected(sk.Corrections(patience=30.0, contraction=0.0))
    assert sweeps == 1
    reached, sweeps, _ = corrected(sk.Corrections(patience=30.0, max_tries=2))
    assert sweeps == 3 and not reached.settled


def test_none_are_made_of_other_steps():
    for other in ({"corrections": None}, {"regular": NO}, {"scale": 10.0}):
        reached, sweeps, after_step = corrected(**({"corrections": sk.Corrections(patience=30.0)} | other))
        assert sweeps == 0 and not reached.settled
        np.testing.assert_array_equal(reached.point.y, after_step)
