"""The shift of an indefinite Hessian: which one is taken, what it makes of the matrix, and how it goes on."""

import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

import shellkit as sk
from shellkit._solve.matrices.pattern import SymmetricPattern
from shellkit._solve.newton.model import QuadraticModel, kept
from shellkit._solve.newton.points import Point, Reached, Step


PATTERN = SymmetricPattern.of(np.arange(3), np.arange(3), 3)[0]
SOLVER = sk.SuperLU()
RHS = jnp.array([1.0, -2.0, 5.0])
NO, YES = jnp.array(False), jnp.array(True)


def diagonal(*entries):
    return sk.SparseSymmetric(PATTERN, jnp.asarray(entries))


def factorised(shift, hessian, convexity=None, begin=0.0, first=NO, once=NO):
    last = kept(SOLVER.factorise(diagonal(1.0, 1.0, 1.0)))
    unit, convexification = hessian.size_of_diagonal(), None if convexity is None else lambda: convexity
    return shift.factorise(
        SOLVER, hessian, convexification, RHS, unit, last, jnp.asarray(begin, dtype=float), first, once
    )


def test_a_definite_matrix_is_left_as_it_is():
    found = factorised(sk.Shift(), diagonal(1.0, 2.0, 4.0))
    assert (float(found.shift), int(found.tries)) == (0.0, 1)
    np.testing.assert_allclose(found.solution, RHS / np.array([1.0, 2.0, 4.0]), rtol=1e-15)


@pytest.mark.parametrize("growth", [4.0, 10.0])
def test_the_shift_is_the_first_on_its_ladder_that_is_enough(growth):
    """Of diag(-1, 2, 3), with the unit 2, it must exceed ½; the k-th above zero is 1e-4 growth^(k (k + 1) / 2)."""
    found = factorised(sk.Shift(growth=growth), diagonal(-1.0, 2.0, 3.0))
    ladder = 1e-4 * growth ** (np.arange(1, 8) * np.arange(2, 9) / 2)
    enough = int(np.argmax(ladder > 0.5))
    np.testing.assert_allclose(found.shift, ladder[enough], rtol=1e-13)
    assert int(found.tries) == enough + 2 and int(found.factor.negative) == 0
    shifted = np.array([-1.0, 2.0, 3.0]) + 2 * ladder[enough]
    np.testing.assert_allclose(found.solution, RHS / shifted, rtol=1e-12)


def test_tries_come_to_an_end():
    for shift, once, tries in ((sk.Shift(max_tries=2), NO, 2), (sk.Shift(), YES, 1)):
        found = factorised(shift, diagonal(-1.0, 2.0, 3.0), once=once)
        assert int(found.tries) == tries and int(found.factor.negative) == 1


def test_the_first_step_of_all_begins_with_longer_strides():
    found = factorised(sk.Shift(first_stride=5), diagonal(-1.0, 2.0, 3.0), first=YES)
    # 4⁵, then 4⁶ times that.
    assert int(found.tries) == 3
    np.testing.assert_allclose(found.shift, 1e-4 * 4.0**11, rtol=1e-13)


def test_half_of_what_makes_it_convex_is_added_at_the_shift_of_that_name():
    shift, hessian, unit = sk.Shift(half_convex=0.02, damping=0.0), diagonal(-1.0, 2.0, 3.0), jnp.asarray(2.0)
    convexity = jnp.array([3.0, 0.0, 1.0])
    half = shift.convexified(hessian, convexity, jnp.asarray(0.02), unit)
    np.testing.assert_allclose(half.values, [0.5, 2.0, 3.5], rtol=1e-15)
    whole = shift.convexified(hessian, convexity, jnp.asarray(1e12), unit)
    np.testing.assert_allclose(whole.values, [2.0, 2.0, 4.0], rtol=1e-12)
    damped = sk.Shift(damping=0.1).convexified(hessian, 0 * convexity, jnp.asarray(1.0), unit)
    np.testing.assert_allclose(damped.values, hessian.values + 0.1 * 1 * 2**2 * 2, rtol=1e-15)


def test_a_convex_model_needs_no_more_than_convexity():
    """-1 + 3 σ / (σ + 1e-3) is positive from σ = 5e-4 on: the second on the ladder, 6.4e-3, is."""
    found = factorised(sk.Shift(damping=0.0), diagonal(-1.0, 2.0, 3.0), diagonal(3.0, 0.0, 0.0))
    np.testing.assert_allclose(found.shift, 6.4e-3, rtol=1e-13)
    part = 6.4e-3 / (6.4e-3 + 1e-3)
    np.testing.assert_allclose(found.solution, RHS / np.array([-1 + 3 * part, 2.0, 3.0]), rtol=1e-12)


def following(before, tries=1, size=0.5, length=1.0, distrusted=False, lost=False, escaping=False):
    factor = SOLVER.factorise(diagonal(1.0, 1.0, 1.0))
    model = QuadraticModel(SOLVER, factor, None, RHS, jnp.asarray(before), jnp.asarray(tries), YES)
    start = Point.unevaluated(RHS)
    step = Step(start, RHS, jnp.asarray(size), jnp.asarray(-1.0), NO, jnp.asarray(escaping), NO)
    reached = Reached(start, jnp.asarray(length), NO)
    after = sk.Shift().after(model, step, reached, jnp.asarray(distrusted), jnp.asarray(lost), jnp.asarray(1.0))
    return float(after)


def test_the_shift_follows_what_the_model_was_worth():
    assert np.isclose(following(1.0), 0.1)
    assert np.isclose(following(1.0, length=0.5), 1.0)
    assert np.isclose(following(1.0, length=0.125, distrusted=True), 4.0)
    assert np.isclose(following(0.0, length=0.125, distrusted=True), 4e-4)
    assert np.isclose(following(1.0, length=0.0, distrusted=True, lost=True), 16.0)
    assert np.isclose(following(1.0, length=0.0, distrusted=True, escaping=True), 1.0)
    # Raised within the step it is kept; of a small step it is dropped, as where next to nothing is left of it.
    assert np.isclose(following(1.0, tries=3), 1.0)
    assert following(1.0, size=1e-3) == 0.0
    assert following(5e-4) == 0.0


def test_without_a_shift_an_indefinite_hessian_ends_the_search_where_it_is():
    start = jnp.array([0.3, 0.0])
    pattern = SymmetricPattern.of(np.arange(2), np.arange(2), 2)[0]
    hessian = lambda y: sk.SparseSymmetric(pattern, jnp.stack([jnp.asarray(2.0), -2 + 12 * y[1] ** 2]))
    found = optx.minimise(
        lambda y, _: y[0] ** 2 - y[1] ** 2 + y[1] ** 4,
        sk.SparseNewton(linear_solver=SOLVER, shift=None),
        start,
        options={"hessian": hessian},
        throw=False,
    )
    assert found.result == optx.RESULTS.nonlinear_divergence
    np.testing.assert_array_equal(found.value, start)
    assert int(found.stats["factorisations"]) == 1
