"""The sparse symmetric pattern and operator against dense matrices."""

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import pytest

from shellkit._solve.matrices.operator import SparseSymmetric
from shellkit._solve.matrices.pattern import SymmetricPattern


def entries(n, count, seed):
    """Random pairs and the dense symmetric matrix they assemble to, with 2n added to the diagonal."""
    rng = np.random.default_rng(seed)
    rows, columns, numbers = rng.integers(0, n, count), rng.integers(0, n, count), rng.standard_normal(count)
    dense = 2.0 * n * np.eye(n)
    for i, j, number in zip(rows, columns, numbers, strict=True):
        dense[i, j] += number
        if i != j:
            dense[j, i] += number
    return rows, columns, numbers, dense


@pytest.fixture
def case():
    rows, columns, numbers, dense = entries(12, 40, 0)
    pattern, positions = SymmetricPattern.of(rows, columns, 12)
    values = jnp.zeros(pattern.nnz).at[positions].add(jnp.asarray(numbers)).at[pattern.diagonal].add(24.0)
    return SparseSymmetric(pattern, values), dense


def test_pattern_merges_swaps_and_keeps_the_diagonal():
    pattern, positions = SymmetricPattern.of(np.array([2, 0, 2, 0]), np.array([0, 2, 1, 1]), 4)
    assert pattern.n == 4
    assert pattern.rows.tolist() == [0, 0, 0, 1, 1, 2, 3]
    assert pattern.indices.tolist() == [0, 1, 2, 1, 2, 2, 3]
    assert pattern.indptr.tolist() == [0, 3, 5, 6, 7]
    assert pattern.diagonal.tolist() == [0, 3, 5, 6]
    assert positions.tolist() == [2, 2, 4, 1]
    assert all(leaf.dtype == jnp.int32 for leaf in (pattern.indptr, pattern.indices, pattern.rows, pattern.diagonal))


def test_fingerprint_tells_patterns_apart_and_nothing_else():
    first, _ = SymmetricPattern.of(np.array([0, 1]), np.array([1, 2]), 4)
    same, _ = SymmetricPattern.of(np.array([2, 1, 0]), np.array([1, 0, 1]), 4)
    other, _ = SymmetricPattern.of(np.array([0, 1]), np.array([1, 3]), 4)
    larger, _ = SymmetricPattern.of(np.array([0, 1]), np.array([1, 2]), 5)
    assert first.fingerprint.tolist() == same.fingerprint.tolist()
    assert first.fingerprint.tolist() not in (other.fingerprint.tolist(), larger.fingerprint.tolist())


def test_pattern_refuses_what_does_not_fit():
    with pytest.raises(ValueError, match=r"pair 1 is \(1, 4\).*size 4"):
        SymmetricPattern.of(np.array([0, 1]), np.array([1, 4]), 4)
    with pytest.raises(ValueError, match=r"\(2,\) and \(3,\)"):
        SymmetricPattern.of(np.array([0, 1]), np.array([1, 2, 3]), 4)


def test_matrix_and_product(case):
    operator, dense = case
    vector = jnp.linspace(-1.0, 2.0, 12)
    np.testing.assert_allclose(operator.as_matrix(), dense, rtol=0, atol=1e-14)
    np.testing.assert_allclose(
        jax.jit(lambda operator, x: operator.mv(x))(operator, vector), dense @ vector, rtol=0, atol=1e-13
    )
    np.testing.assert_allclose(operator.shifted(-3.0).as_matrix(), dense - 3.0 * np.eye(12), rtol=0, atol=1e-14)


def test_acts_on_pytrees(case):
    operator, dense = case
    vector = {"vertices": jnp.arange(9.0).reshape(3, 3), "angles": jnp.array([1.0, -1.0, 0.5])}
    shaped = SparseSymmetric(operator.pattern, operator.values, like=vector)
    assert shaped.in_structure() == shaped.out_structure() == jax.eval_shape(lambda: vector)
    flat = np.concatenate([vector["angles"], vector["vertices"].ravel()])
    image = shaped.mv(vector)
    np.testing.assert_allclose(image["angles"], (dense @ flat)[:3], atol=1e-12)
    np.testing.assert_allclose(image["vertices"], (dense @ flat)[3:].reshape(3, 3), atol=1e-12)


def test_refuses_shapes_that_do_not_fit(case):
    operator, _ = case
    with pytest.raises(ValueError, match=rf"\(5,\).*\({operator.pattern.nnz},\)"):
        SparseSymmetric(operator.pattern, jnp.zeros(5))
    with pytest.raises(ValueError, match="hold 9 numbers, but the matrix has size 12"):
        SparseSymmetric(operator.pattern, operator.values, like=jnp.zeros((3, 3)))


def test_answers_all_that_lineax_asks(case):
    operator, dense = case
    assert operator.T is operator and lx.conj(operator) is operator
    assert lx.linearise(operator) is operator and lx.materialise(operator) is operator
    np.testing.assert_allclose(lx.diagonal(operator), np.diag(dense), atol=1e-14)
    for band, offset in zip(lx.tridiagonal(operator), (0, -1, 1), strict=True):
        np.testing.assert_allclose(band, np.diagonal(dense, offset), atol=1e-14)
    assert lx.is_symmetric(operator)
    for claim in (
        lx.is_diagonal,
        lx.is_tridiagonal,
        lx.is_lower_triangular,
        lx.is_upper_triangular,
        lx.has_unit_diagonal,
        lx.is_positive_semidefinite,
        lx.is_negative_semidefinite,
    ):
        assert not claim(operator)
    np.testing.assert_allclose(
        (2.0 * operator + operator @ operator).as_matrix(), 2 * dense + dense @ dense, atol=1e-10
    )


def test_derivatives_of_the_product(case):
    operator, _ = case
    vector = jnp.linspace(-1.0, 2.0, 12)

    def sparse(values, vector):
        return jnp.sum(jnp.sin(SparseSymmetric(operator.pattern, values).mv(vector)))

    def dense(values, vector):
        return jnp.sum(jnp.sin(SparseSymmetric(operator.pattern, values).as_matrix() @ vector))

    tangents = (jnp.cos(jnp.arange(operator.pattern.nnz)), jnp.sin(jnp.arange(12)))
    for f, g in ((sparse, dense), (jax.jit(sparse), dense)):
        arguments = (operator.values, vector)
        np.testing.assert_allclose(jax.jvp(f, arguments, tangents)[1], jax.jvp(g, arguments, tangents)[1], atol=1e-10)
        for argument in (0, 1):
            np.testing.assert_allclose(jax.grad(f, argument)(*arguments), jax.grad(g, argument)(*arguments), atol=1e-12)
    second = jax.jvp(jax.grad(sparse), (operator.values, vector), tangents)[1]
    np.testing.assert_allclose(second, jax.jvp(jax.grad(dense), (operator.values, vector), tangents)[1], atol=1e-8)


def test_conjugate_gradients_of_lineax_under_vmap(case):
    operator, dense = case
    right = jnp.linspace(1.0, 2.0, 12)

    def solve(values, right):
        tagged = lx.TaggedLinearOperator(SparseSymmetric(operator.pattern, values), lx.positive_semidefinite_tag)
        return lx.linear_solve(tagged, right, lx.CG(rtol=1e-12, atol=1e-12)).value

    expected = np.linalg.solve(dense, right)
    np.testing.assert_allclose(solve(operator.values, right), expected, atol=1e-10)
    over_values = jax.vmap(solve, in_axes=(0, None))(jnp.stack([operator.values, 2 * operator.values]), right)
    np.testing.assert_allclose(over_values, [expected, expected / 2], atol=1e-10)
    over_vectors = jax.vmap(solve, in_axes=(None, 0))(operator.values, jnp.stack([right, -right]))
    np.testing.assert_allclose(over_vectors, [expected, -expected], atol=1e-10)
