"""Conjugate gradients: convergence, preconditioning, and what they say when they cannot."""

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import pytest

from shellkit._solve.linear.iterative import ConjugateGradients
from shellkit._solve.linear.superlu import SuperLU
from shellkit._solve.matrices.operator import SparseSymmetric
from shellkit._solve.matrices.pattern import SymmetricPattern


def springs(n=30, seed=0):
    """A chain of n/3 point masses in space, with springs of widely different stiffness along it and to ground."""
    rng = np.random.default_rng(seed)
    masses = n // 3
    rows, columns, values = [], [], []
    for k in range(masses):
        stiffness = 10 ** rng.uniform(-2, 2) * np.cov(rng.standard_normal((3, 8)))
        for other, sign in ((k, 1.0), (k + 1, -1.0)):
            if k + 1 < masses or other == k:
                for i in range(3):
                    for j in range(i if other == k else 0, 3):
                        rows.append(3 * k + i)
                        columns.append(3 * other + j)
                        values.append(sign * stiffness[i, j])
        if k + 1 < masses:
            for i in range(3):
                for j in range(i, 3):
                    rows.append(3 * (k + 1) + i)
                    columns.append(3 * (k + 1) + j)
                    values.append(stiffness[i, j])
    pattern, positions = SymmetricPattern.of(np.array(rows), np.array(columns), n)
    summed = jnp.zeros(pattern.nnz).at[positions].add(jnp.asarray(values))
    return SparseSymmetric(pattern, summed), jnp.asarray(rng.standard_normal(n))


def test_solves_and_preconditioning_pays():
    operator, right = springs()
    expected = np.linalg.solve(operator.as_matrix(), right)
    steps = {}
    for block in (1, 3):
        solver = ConjugateGradients(rtol=1e-12, block=block, max_steps=1000)
        end = jax.jit(solver.descend)(solver.factorise(operator), right)
        assert bool(end.converged) and not bool(end.negative)
        np.testing.assert_allclose(end.solution, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
        steps[block] = int(end.steps)
    assert steps[3] < steps[1]
    several = solver.solve(solver.factorise(operator), jnp.stack([right, -right]))
    np.testing.assert_allclose(several[0], -several[1])


def test_blocks_need_not_divide_the_size():
    operator, right = springs()
    solver = ConjugateGradients(rtol=1e-13, block=4, max_steps=1000)
    solution = solver.solve(solver.factorise(operator), right)
    np.testing.assert_allclose(operator.mv(solution), right, atol=1e-10)


def test_the_factor_of_an_older_matrix():
    operator, right = springs()
    direct = SuperLU()
    solver = ConjugateGradients(rtol=1e-12, direct=direct)
    newer = SparseSymmetric(operator.pattern, 1.1 * operator.values).shifted(0.01)
    factor = solver.factorise(newer, stale=direct.factorise(operator))
    end = solver.descend(factor, right)
    plain = ConjugateGradients(rtol=1e-12, max_steps=1000)
    assert bool(end.converged)
    assert int(end.steps) < int(plain.descend(plain.factorise(newer), right).steps)
    np.testing.assert_allclose(newer.mv(end.solution), right, atol=1e-9)
    with pytest.raises(ValueError, match="direct="):
        plain.factorise(newer, stale=factor.token)


def test_exact_factor_takes_one_step():
    operator, right = springs()
    direct = SuperLU()
    solver = ConjugateGradients(direct=direct, rtol=1e-8)
    end = solver.descend(solver.factorise(operator, stale=direct.factorise(operator)), right)
    assert int(end.steps) == 1


def test_negative_curvature_is_met_and_shown():
    pattern, _ = SymmetricPattern.of([0, 1, 0], [1, 2, 3], 6)
    matrix = SparseSymmetric(pattern, jnp.where(pattern.rows == pattern.indices, 1.0, 0.9))
    assert np.linalg.eigvalsh(matrix.as_matrix())[0] < 0
    solver = ConjugateGradients(block=1)
    factor = solver.factorise(matrix)
    assert int(factor.negative) == -1  # the diagonal does not show it
    right = jnp.array([1.0, -1.0, 1.0, -1.0, 0.0, 1.0])
    end = jax.jit(solver.descend)(factor, right)
    assert bool(end.negative) and not bool(end.converged)
    assert float(end.direction @ matrix.mv(end.direction)) <= 0
    assert lx.linear_solve(matrix, right, solver, throw=False).result == lx.RESULTS.breakdown
    assert int(ConjugateGradients(block=3).factorise(matrix).negative) == 1  # a block does


def test_unconverged_is_reported():
    operator, right = springs()
    solver = ConjugateGradients(max_steps=2)
    assert lx.linear_solve(operator, right, solver, throw=False).result == lx.RESULTS.max_steps_reached
    with pytest.raises(Exception, match="max_steps"):
        lx.linear_solve(operator, right, solver)


def test_right_hand_side_zero():
    operator, right = springs()
    solver = ConjugateGradients()
    end = solver.descend(solver.factorise(operator), 0 * right)
    assert bool(end.converged) and int(end.steps) == 0
    assert not np.any(end.solution)


def test_derivatives_and_batches():
    operator, right = springs()
    solver = ConjugateGradients(rtol=1e-13, max_steps=1000)

    def sparse(values, right):
        return jnp.sum(jnp.sin(lx.linear_solve(SparseSymmetric(operator.pattern, values), right, solver).value))

    def dense(values, right):
        return jnp.sum(jnp.sin(jnp.linalg.solve(SparseSymmetric(operator.pattern, values).as_matrix(), right)))

    values = operator.shifted(1.0).values
    for argument in (0, 1):
        expected = jax.grad(dense, argument)(values, right)
        np.testing.assert_allclose(jax.jit(jax.grad(sparse, argument))(values, right), expected, atol=1e-8)
    batch = jax.vmap(sparse, (0, None))(jnp.stack([values, 2 * values]), right)
    np.testing.assert_allclose(batch, [dense(values, right), dense(2 * values, right)], atol=1e-9)


def test_faults():
    operator, right = springs()
    solver = ConjugateGradients()
    broken = SparseSymmetric(operator.pattern, operator.values * jnp.nan)
    assert not bool(solver.factorise(broken).ok)
    assert lx.linear_solve(broken, right, solver, throw=False).result != lx.RESULTS.successful
    with pytest.raises(ValueError, match=r"float64.*float32"):
        solver.factorise(SparseSymmetric(operator.pattern, operator.values.astype(jnp.float32)))
