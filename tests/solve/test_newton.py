"""SparseNewton on small functions with known minima, outside any shell: saddles, motions, refusals."""

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

import shellkit as sk
from shellkit._solve.matrices.pattern import SymmetricPattern
from shellkit._solve.newton.objective import NewtonObjective
from shellkit._solve.newton.plain import PlainNewton
from shellkit._solve.null_space import gauge_coordinates, orthonormal


def dense_hessian(function, n):
    rows, columns = np.triu_indices(n)
    pattern, positions = SymmetricPattern.of(rows, columns, n)

    def hessian(y):
        upper = jax.hessian(function)(y)[rows, columns]
        return sk.SparseSymmetric(pattern, jnp.zeros(pattern.nnz).at[positions].set(upper))

    return hessian


def minimise(function, start, **options):
    start = jnp.asarray(start, dtype=float)
    return optx.minimise(
        lambda y, _: function(y),
        sk.SparseNewton(),
        start,
        options={"hessian": dense_hessian(function, start.size), **options},
        throw=False,
    )


def rosenbrock(y):
    return jnp.sum(100 * (y[1:] - y[:-1] ** 2) ** 2 + (1 - y[:-1]) ** 2)


def test_rosenbrock():
    solution = minimise(rosenbrock, [-1.2, 1.0])
    assert solution.result == optx.RESULTS.successful
    assert jnp.allclose(solution.value, 1.0, atol=1e-10)


def test_saddle_is_left():
    """x² - y² + y⁴/2 from its saddle at the origin, where the gradient vanishes exactly."""
    solution = minimise(lambda y: y[0] ** 2 - y[1] ** 2 + 0.5 * y[1] ** 4, [0.0, 0.0])
    assert solution.result == optx.RESULTS.successful
    assert np.allclose(np.abs(solution.value), [0, 1], atol=1e-10)


def test_motions_are_held_and_projected_out():
    """Two springs in a row: translation is free, and the solution is the one with no net motion."""
    function = lambda y: (y[1] - y[0] - 1.0) ** 2 + 2 * (y[2] - y[1] - 2.0) ** 2
    solution = minimise(function, [0.1, 0.0, -0.3], motions=lambda y: jnp.ones((3, 1)))
    assert solution.result == optx.RESULTS.successful
    assert np.allclose(np.diff(solution.value), [1, 2], atol=1e-12)
    assert np.isclose(float(solution.value.sum()), -0.2, atol=1e-12)


def test_infeasible_steps_are_not_taken():
    """log needs y > 0: a full Newton step from 5 would leave it."""
    function = lambda y: jnp.sum(y - jnp.log(y))
    solution = minimise(function, [5.0], feasible=lambda y, new: jnp.all(new > 0.1 * y))
    assert solution.result == optx.RESULTS.successful and np.isclose(float(solution.value[0]), 1.0)


def test_unbounded_function_does_not_claim_success():
    solution = minimise(lambda y: -jnp.sum(y**2) + y[0], [1.0, 2.0])
    assert solution.result != optx.RESULTS.successful


def test_energy_that_is_not_finite_does_not_claim_success():
    solution = minimise(lambda y: jnp.sum(jnp.log(y) * y), [-1.0, 2.0])
    assert solution.result != optx.RESULTS.successful


def test_without_a_hessian_the_remedy_is_named():
    with pytest.raises(ValueError, match="BFGS"):
        optx.minimise(lambda y, _: jnp.sum(y**2), sk.SparseNewton(), jnp.ones(2))


def convex(y):
    return jnp.sum(jnp.cosh(y - jnp.arange(3.0))) + (y[0] - y[1]) ** 2


def state_of(newton, function, start):
    start = jnp.asarray(start, dtype=float)
    objective = NewtonObjective.from_options(
        lambda y, _: (function(y), None), None, {"hessian": dense_hessian(function, start.size)}
    )
    return newton.minimise(objective, start, 100)


def test_the_core_and_its_adapter_are_one_method():
    state, steps = state_of(sk.SparseNewton().core, rosenbrock, [-1.2, 1.0])
    solution = minimise(rosenbrock, [-1.2, 1.0])
    assert state.result == solution.result and int(steps) == int(solution.stats["num_steps"])
    np.testing.assert_array_equal(state.point.y, solution.value)


def test_where_nothing_goes_wrong_the_plain_method_takes_the_same_steps():
    start = [2.0, -1.0, 0.5]
    whole, plain = (state_of(s.core, convex, start) for s in (sk.SparseNewton(), PlainNewton(sk.SparseNewton())))
    assert plain[0].done and int(plain[1]) == int(whole[1])
    np.testing.assert_allclose(plain[0].point.y, whole[0].point.y, atol=1e-15)


def test_the_plain_method_stops_where_the_whole_one_has_to_go_on():
    start = [-1.2, 1.0]
    plain, steps = state_of(PlainNewton(sk.SparseNewton()).core, rosenbrock, start)
    assert plain.stuck and not plain.done
    whole, more = state_of(sk.SparseNewton().core, rosenbrock, plain.point.y)
    assert whole.done and int(steps) - 1 + int(more) == int(state_of(sk.SparseNewton().core, rosenbrock, start)[1])


@pytest.mark.parametrize("solver", [sk.Pardiso, sk.Cholmod, sk.SuperLU])
def test_every_direct_solver(solver):
    mesh = sk.meshes.icosphere(subdivisions=1)
    problem = sk.InverseProblem(
        mesh=mesh,
        thickness=0.1,
        actuation=sk.IsotropicGrowth(1.1),
        energy=sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0),
        solver=sk.SparseNewton(linear_solver=solver()),
    )
    equilibrium = problem()
    assert bool(equilibrium.converged) and float(equilibrium.gradient_norm) < 1e-12


def test_held_coordinates_stop_every_motion():
    motions = jnp.asarray(np.random.default_rng(0).normal(size=(30, 6)))
    basis = orthonormal(motions)
    held = gauge_coordinates(basis)
    assert len(set(held.tolist())) == 6
    assert np.linalg.cond(basis[held]) < 100
