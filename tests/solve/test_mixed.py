"""Steps with strains as unknowns of their own, on a function small enough to be written out: a mass on a stiff string,
pushed round a circle."""

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

import shellkit as sk
from shellkit._solve.matrices.pattern import SymmetricPattern


PATTERN, POSITIONS = SymmetricPattern.of(np.array([0, 0, 1]), np.array([0, 1, 1]), 2)
START, END = jnp.array([0.0, 1.0]), np.array([0.7, np.sqrt(0.51)])


def string(stiffness, apart=True, **limits):
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
    found = optx.minimise(lambda y, _: value(y), sk.SparseNewton(), START, options=options, throw=False, **limits)
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
    assert int(string(1e6, apart=False)[0].stats["num_steps"]) > 3 * max(steps)


@pytest.mark.parametrize("max_steps", [2, 4])
def test_cut_short_it_is_no_higher_than_at_the_start(max_steps):
    """In the midst of such steps the energy is far above; what is returned is where they began."""
    found, rise = string(1e6, max_steps=max_steps)
    assert rise <= 0
    assert found.result != optx.RESULTS.successful
