"""Bounds on trained arrays, by a smooth change of variables."""

import jax.numpy as jnp
import numpy as np
import optax
import pytest

from shellkit._fit.design import Bounds
from shellkit._fit.fit import fit


@pytest.mark.parametrize("target", [0.6, 7.0])
def test_stays_within_and_reaches_what_it_can(make_quadratic, angle, target):
    problem = make_quadratic(1, target=jnp.full(1, target))
    seen = []
    result = fit(
        problem,
        optax.adam(0.1),
        steps=150,
        where=angle,
        bounds=[Bounds(angle, -1.0, 1.0)],
        callbacks=[lambda info: seen.append(float(info.problem.actuation.angle[0]))],
    )
    assert max(map(abs, seen)) < 1
    assert float(result.problem.actuation.angle[0]) == pytest.approx(min(target / 1.01, 1.0), abs=1e-2)


def test_in_the_middle_nothing_changes(make_quadratic, angle):
    # The loss is even about the middle of the bounds; one step of gradient descent is tanh of the step without bounds.
    problem = make_quadratic(1)
    free = fit(problem, optax.sgd(0.1), steps=2, where=angle).last_problem.actuation.angle
    bounded = fit(problem, optax.sgd(0.1), steps=2, where=angle, bounds=[Bounds(angle, -3.0, 3.0)])
    np.testing.assert_allclose(bounded.last_problem.actuation.angle, 3 * np.tanh(free / 3), rtol=1e-12)


def test_the_gradient_is_that_of_the_free_variable(make_quadratic, angle):
    problem = make_quadratic(1, start=0.5)
    row = fit(problem, optax.sgd(0.1), steps=1, where=angle, bounds=[Bounds(angle, -1.0, 1.0)]).history
    # dx/du = 1 - x² at x = tanh u, and the derivative of the loss in x is 2.02 x - 2.
    assert row["gradient_norm"][0] == pytest.approx(abs(2.02 * 0.5 - 2) * (1 - 0.25))


def test_bounds_per_entry_and_of_one_array_among_two(make_quadratic, angle):
    problem = make_quadratic(start=0.5)
    high = jnp.array([0.6, 5.0, 0.7])
    bounds = [Bounds(lambda p: p.actuation.angle, 0.0, high)]
    result = fit(problem, optax.adam(0.05), steps=60, where=lambda p: (p.actuation.angle, p.target), bounds=bounds)
    assert (np.asarray(result.problem.actuation.angle) < high).all()
    assert float(result.problem.actuation.angle[1]) > 0.7


@pytest.mark.parametrize(
    ("bounds", "message"),
    [
        (Bounds(lambda p: p.actuation.angle, 1.0, 1.0), "low < high"),
        (Bounds(lambda p: p.actuation.angle, 0.0, 1.0), "starts on or outside its bounds at 3 of 3"),
        (
            Bounds(lambda p: p.actuation.angle, np.full(2, -1.0), 1.0),
            r"shape \(2,\), which does not broadcast to \(3,\)",
        ),
        (Bounds(lambda p: p.weight, 0.0, 2.0), "weight, which is not trained"),
        (Bounds(lambda p: p.kind, 0.0, 2.0), "Bounds.where: item 0"),
    ],
)
def test_bounds_that_cannot_be(make_quadratic, angle, bounds, message):
    with pytest.raises(ValueError, match=message):
        fit(make_quadratic(), optax.sgd(0.1), steps=1, where=angle, bounds=[bounds])


def test_bounds_are_part_of_a_checkpoint(make_quadratic, angle, tmp_path):
    def run(steps, high):
        bounds = [Bounds(angle, -1.0, high)]
        path = tmp_path / f"run{high}"
        return fit(make_quadratic(), optax.adam(0.1), steps=steps, where=angle, bounds=bounds, checkpoint=path)

    run(5, 1.0)
    resumed, straight = run(9, 1.0), run(9, 1.0 + 1e-12)
    np.testing.assert_allclose(resumed.history["loss"], straight.history["loss"], rtol=1e-9)
    (tmp_path / "run1.0").rename(tmp_path / "run2.0")
    with pytest.raises(ValueError, match=r"bounds.actuation.angle.high"):
        run(9, 2.0)
