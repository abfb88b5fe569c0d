"""The derivative of a minimum, with the factor that a relaxation left and without, on a chain of springs whose exact
derivative is a dense solution."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

import shellkit as sk
from shellkit._solve.adjoint import differentiable_minimum
from shellkit._solve.linear.base import LastFactor
from shellkit._solve.linear.choose import default_linear_solver
from shellkit._solve.matrices.pattern import SymmetricPattern


N = 3200
_ROWS = np.concatenate([np.arange(N), np.arange(N - 1)])
_COLUMNS = np.concatenate([np.arange(N), np.arange(1, N)])


class Chain(eqx.Module):
    """Masses in a row, on springs that stiffen."""

    force: Float[Array, " n"]
    pattern: SymmetricPattern
    positions: Array

    @classmethod
    def of(cls, force):
        pattern, positions = SymmetricPattern.of(_ROWS, _COLUMNS, N)
        return cls(force, pattern, jnp.asarray(positions))

    def gradient(self, y):
        steps = jnp.diff(y)
        return jnp.pad(-steps, (0, 1)) + jnp.pad(steps, (1, 0)) + 0.1 * y + y**3 - self.force

    def hessian(self, y):
        ends = jnp.ones(N).at[jnp.array([0, -1])].set(0.0)
        values = jnp.concatenate([1.1 + ends + 3 * y**2, -jnp.ones(N - 1)])
        return sk.SparseSymmetric(self.pattern, jnp.zeros(self.pattern.nnz).at[self.positions].set(values))


@pytest.fixture(scope="module")
def chain():
    y = jnp.sin(jnp.arange(N) / 50)
    still = Chain.of(jnp.zeros(N))
    return Chain.of(still.gradient(y)), y


def derivative(chain, y, direction, last):
    solver = default_linear_solver()
    return jax.jvp(
        lambda force: differentiable_minimum(Chain.of(force), y, None, solver, last), (chain.force,), (direction,)
    )[1]


def kept(factor):
    return LastFactor.of(factor), factor.pattern


@pytest.mark.parametrize("off", [None, 0.0, 0.05, 30.0], ids=["none", "of the minimum", "of nearby", "of far away"])
def test_whatever_factor_is_left(chain, off):
    chain, y = chain
    direction = jax.random.normal(jax.random.key(0), (N,))
    last = None
    if off is not None:
        near = y + off * jax.random.normal(jax.random.key(1), (N,))
        last = kept(default_linear_solver().factorise(chain.hessian(near)))
    exact = np.linalg.solve(chain.hessian(y).as_matrix(), direction)
    found = derivative(chain, y, direction, last)
    assert np.linalg.norm(found - exact) < 1e-11 * np.linalg.norm(exact)


def test_factor_overwritten_by_that_of_another_matrix(chain):
    chain, y = chain
    solver = default_linear_solver()
    direction = jax.random.normal(jax.random.key(0), (N,))
    last = kept(solver.factorise(chain.hessian(y)))
    jax.block_until_ready(solver.factorise(chain.hessian(100 * jnp.flip(y) + 7)).negative)
    exact = np.linalg.solve(chain.hessian(y).as_matrix(), direction)
    assert np.linalg.norm(derivative(chain, y, direction, last) - exact) < 1e-11 * np.linalg.norm(exact)


def test_singular_hessian_gives_no_number(chain):
    chain, _ = chain

    class Slack(Chain):
        def hessian(self, y):
            matrix = super().hessian(y)
            return eqx.tree_at(lambda m: m.values, matrix, jnp.zeros_like(matrix.values))

    slack = Slack(chain.force, chain.pattern, chain.positions)
    y = jnp.zeros(N)
    last = kept(default_linear_solver().factorise(chain.hessian(y)))
    solver = default_linear_solver()
    moved = jax.jvp(
        lambda force: differentiable_minimum(eqx.tree_at(lambda c: c.force, slack, force), y, None, solver, last),
        (chain.force,),
        (jnp.ones(N),),
    )[1]
    assert np.all(np.isnan(moved))
