"""Every direct solver on matrices of known inertia, inside every transformation, against dense solutions."""

import importlib.util

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import pytest

from shellkit._solve.linear.cholmod import Cholmod
from shellkit._solve.linear.choose import default_linear_solver, linear_solver
from shellkit._solve.linear.pardiso import Pardiso
from shellkit._solve.linear.superlu import SuperLU
from shellkit._solve.matrices.operator import SparseSymmetric
from shellkit._solve.matrices.pattern import SymmetricPattern


def needs(solver, module):
    missing = importlib.util.find_spec(module) is None
    return pytest.param(solver, marks=pytest.mark.skipif(missing, reason=f"needs {module}"), id=type(solver).__name__)


PARDISO = needs(Pardiso(), "pardiso_mkl_jax")
CHOLMOD = needs(Cholmod(), "sparsax")
SUPERLU = needs(SuperLU(), "scipy")
every_solver = pytest.mark.parametrize("solver", [PARDISO, CHOLMOD, SUPERLU])
with_inertia = pytest.mark.parametrize("solver", [PARDISO, SUPERLU])


def system(n=40, negative=0, seed=0):
    """A diagonally dominant matrix: by Gershgorin, as many eigenvalues are negative as diagonal entries are."""
    rng = np.random.default_rng(seed)
    rows, columns = rng.integers(0, n, 4 * n), rng.integers(0, n, 4 * n)
    apart = rows != columns
    pattern, positions = SymmetricPattern.of(rows[apart], columns[apart], n)
    values = np.zeros(pattern.nnz)
    values[positions] = rng.standard_normal(apart.sum())
    dominance = np.zeros(n)
    for i, j, number in zip(np.asarray(pattern.rows), np.asarray(pattern.indices), values, strict=True):
        dominance[i] += abs(number)
        dominance[j] += abs(number)
    signs = np.where(rng.permutation(n) < negative, -1.0, 1.0)
    values[np.asarray(pattern.diagonal)] = signs * (dominance + 0.5)
    return SparseSymmetric(pattern, jnp.asarray(values)), jnp.asarray(rng.standard_normal(n))


def dense_solution(operator, right):
    return np.linalg.solve(operator.as_matrix(), right)


@every_solver
@pytest.mark.parametrize("compiled", [False, True])
def test_positive_definite(solver, compiled):
    operator, right = system()
    factorise, solve = (
        (jax.jit(solver.factorise), jax.jit(solver.solve)) if compiled else (solver.factorise, solver.solve)
    )
    factor = factorise(operator)
    assert bool(factor.ok) and int(factor.negative) == 0
    np.testing.assert_allclose(solve(factor, right), dense_solution(operator, right), rtol=0, atol=1e-13)
    several = jnp.stack([right, 2 * right, jnp.ones(40)])
    solutions = solve(factor, several)
    assert solutions.shape == (3, 40)
    np.testing.assert_allclose(solutions, dense_solution(operator, several.T).T, rtol=0, atol=1e-13)


@with_inertia
@pytest.mark.parametrize("negative", [1, 7, 40])
def test_inertia(solver, negative):
    operator, right = system(negative=negative)
    assert np.sum(np.linalg.eigvalsh(operator.as_matrix()) < 0) == negative
    factor = solver.factorise(operator)
    assert bool(factor.ok) and int(factor.negative) == negative
    np.testing.assert_allclose(solver.solve(factor, right), dense_solution(operator, right), rtol=0, atol=1e-13)


@pytest.mark.parametrize("solver", [CHOLMOD])
def test_cholesky_reports_an_indefinite_matrix(solver):
    operator, right = system(negative=1)
    factor = jax.jit(solver.factorise)(operator)
    assert not bool(factor.ok) and int(factor.negative) == -1
    assert lx.linear_solve(operator, right, solver, throw=False).result == lx.RESULTS.singular


@with_inertia
def test_no_pivot_on_the_diagonal(solver):
    pattern, _ = SymmetricPattern.of([0], [1], 2)
    operator = SparseSymmetric(pattern, jnp.array([0.0, 2.0, 0.0]))
    factor = solver.factorise(operator)
    assert int(factor.negative) in (1, -1)
    np.testing.assert_allclose(solver.solve(factor, jnp.array([2.0, 6.0])), [3.0, 1.0], atol=1e-14)


@every_solver
@pytest.mark.parametrize("fault", ["singular", "zero", "nan"])
def test_faults_are_reported(solver, fault):
    if fault == "singular":  # the Laplacian of a path, which has the constants in its kernel
        pattern, _ = SymmetricPattern.of([0, 1], [1, 2], 3)
        operator = SparseSymmetric(pattern, jnp.array([1.0, -1.0, 2.0, -1.0, 1.0]))
    else:
        operator, _ = system()
        operator = SparseSymmetric(operator.pattern, operator.values * (0.0 if fault == "zero" else jnp.nan))
    factor = jax.jit(solver.factorise)(operator)
    assert not bool(factor.ok)
    right = jnp.ones(operator.pattern.n)
    assert lx.linear_solve(operator, right, solver, throw=False).result == lx.RESULTS.singular
    with pytest.raises(Exception, match="singular"):
        lx.linear_solve(operator, right, solver)


@every_solver
def test_inside_a_loop(solver):
    """A Newton method's use: a new matrix and a new right-hand side, made from the last solution, in every turn."""
    operator, right = system()

    @jax.jit
    def loop(operator, right):
        def turn(state):
            count, right, _ = state
            factor = solver.factorise(operator.shifted(1.0 * count))
            return count + 1, solver.solve(factor, right), factor

        return jax.lax.while_loop(lambda state: state[0] < 5, turn, (0, right, solver.factorise(operator)))

    _, result, factor = loop(operator, right)
    expected = right
    for shift in range(5):
        expected = dense_solution(operator.shifted(float(shift)), expected)
    np.testing.assert_allclose(result, expected, rtol=1e-11)
    np.testing.assert_allclose(solver.solve(factor, right), dense_solution(operator.shifted(4.0), right), atol=1e-13)


@every_solver
def test_derivatives(solver):
    operator, right = system()
    values, pattern = operator.values, operator.pattern

    def sparse(values, right):
        return jnp.sum(lx.linear_solve(SparseSymmetric(pattern, values), right, solver).value ** 3)

    def dense(values, right):
        return jnp.sum(jnp.linalg.solve(SparseSymmetric(pattern, values).as_matrix(), right) ** 3)

    tangents = (jnp.cos(jnp.arange(pattern.nnz)), jnp.sin(jnp.arange(40)))
    expected = jax.jvp(dense, (values, right), tangents)[1]
    np.testing.assert_allclose(jax.jvp(sparse, (values, right), tangents)[1], expected, rtol=1e-10)
    for argument in (0, 1):
        gradient = jax.jit(jax.grad(sparse, argument))(values, right)
        np.testing.assert_allclose(gradient, jax.grad(dense, argument)(values, right), atol=1e-13)
    second = jax.jvp(jax.grad(sparse), (values, right), tangents)[1]
    np.testing.assert_allclose(second, jax.jvp(jax.grad(dense), (values, right), tangents)[1], atol=1e-12)


@every_solver
def test_a_given_factor_serves_linear_solve(solver):
    operator, right = system()
    shaped = SparseSymmetric(operator.pattern, operator.values, like=jnp.zeros((20, 2)))
    factor = solver.factorise(shaped)
    solution = lx.linear_solve(shaped, right.reshape(20, 2), solver, state=factor).value
    np.testing.assert_allclose(solution, dense_solution(operator, right).reshape(20, 2), atol=1e-13)


@every_solver
def test_batches(solver):
    operator, right = system()
    matrices = jnp.stack([operator.values, operator.shifted(1.0).values, 2 * operator.values])
    rights = jnp.stack([right, -right, 3 * right])

    def solve(values, right):
        factor = solver.factorise(SparseSymmetric(operator.pattern, values))
        return solver.solve(factor, right), factor.negative

    def through_lineax(values, right):
        return lx.linear_solve(SparseSymmetric(operator.pattern, values), right, solver).value

    one = dense_solution(operator, right)
    other = dense_solution(operator.shifted(1.0), right)
    for batched in (jax.vmap(solve), lambda *arguments: jax.lax.map(lambda pair: solve(*pair), arguments)):
        solutions, negatives = jax.jit(batched)(matrices, rights)
        np.testing.assert_allclose(solutions, [one, -other, 1.5 * one], atol=1e-13)
        assert negatives.tolist() == [0, 0, 0]
    np.testing.assert_allclose(jax.vmap(through_lineax, (0, None))(matrices, right), [one, other, one / 2], atol=1e-13)
    np.testing.assert_allclose(
        jax.vmap(through_lineax, (None, 0))(matrices[0], rights), [one, -one, 3 * one], atol=1e-13
    )
    factor = solver.factorise(operator)
    np.testing.assert_allclose(jax.vmap(solver.solve, (None, 0))(factor, rights), [one, -one, 3 * one], atol=1e-13)
    gradients = jax.vmap(jax.grad(lambda v, r: jnp.sum(through_lineax(v, r))), (0, None))(matrices, right)
    alone = [jax.grad(lambda v: jnp.sum(through_lineax(v, right)))(values) for values in matrices]
    np.testing.assert_allclose(gradients, alone, atol=1e-13)


@every_solver
def test_a_batch_whose_loops_end_apart(solver):
    """The carried factor gets a batch axis, its pattern with it."""
    operator, right = system()

    def loop(turns):
        def turn(state):
            count, _, factor = state
            factor = solver.factorise(SparseSymmetric(factor.pattern, operator.values).shifted(1.0 * count))
            return count + 1, solver.solve(factor, right), factor

        return jax.lax.while_loop(lambda s: s[0] < turns, turn, (0, right, solver.factorise(operator)))[1]

    results = jax.jit(jax.vmap(loop))(jnp.array([1, 3]))
    expected = [dense_solution(operator.shifted(float(shift)), right) for shift in (0, 2)]
    np.testing.assert_allclose(results, expected, atol=1e-13)


@every_solver
def test_factors_are_never_mixed_up(solver):
    """Two matrices of one pattern and one of another, solved in turns, in one compiled function and apart."""
    first, right = system(seed=1)
    second = SparseSymmetric(first.pattern, 2 * first.values).shifted(3.0)
    third, _ = system(seed=2)
    matrices = (first, second, third)
    expected = [dense_solution(matrix, right) for matrix in matrices]
    factors = [solver.factorise(matrix) for matrix in matrices]
    for turn in (0, 1, 2, 0, 2, 1, 1):
        np.testing.assert_allclose(solver.solve(factors[turn], right), expected[turn], atol=1e-13)

    @jax.jit
    def together(matrices):
        factors = [solver.factorise(matrix) for matrix in matrices]
        return [solver.solve(factor, right) for factor in (*factors, factors[0])]

    np.testing.assert_allclose(together(matrices), [*expected, expected[0]], atol=1e-13)


@every_solver
def test_a_slightly_different_matrix_is_told_apart(solver):
    """An ill-conditioned matrix whose values move by 1e-9: the older factor would be off by far more than rounding."""
    n = 40
    pattern, _ = SymmetricPattern.of(np.arange(n - 1), np.arange(1, n), n)
    chain = jnp.where(pattern.rows == pattern.indices, 2.0, -1.0).at[0].set(1.0 + 1e-7)  # nearly in free motion
    older, newer = (SparseSymmetric(pattern, chain.at[pattern.diagonal[-1]].set(c)) for c in (1.0, 1.0 + 1e-9))
    factor = solver.factorise(older)
    solver.factorise(newer)
    solution = solver.solve(factor, jnp.ones(n))
    np.testing.assert_allclose(solution, dense_solution(older, jnp.ones(n)), rtol=1e-6)


def test_pardiso_analyses_a_pattern_once():
    primitive = pytest.importorskip("pardiso_mkl_jax.primitive")
    operator, right = system(n=37, seed=11)
    solver = Pardiso()
    before = primitive.rebuild_count()

    @jax.jit
    def several(operator, right):
        def turn(state):
            count, right = state
            return count + 1, solver.solve(solver.factorise(operator.shifted(1.0 * count)), right)

        return jax.lax.while_loop(lambda state: state[0] < 4, turn, (0, right))[1]

    several(operator, right)
    jax.jit(lambda values: lx.linear_solve(SparseSymmetric(operator.pattern, values), right, solver).value)(
        operator.values
    )
    jax.vmap(lambda values: solver.factorise(SparseSymmetric(operator.pattern, values)).negative)(
        jnp.stack([operator.values, 2 * operator.values])
    )
    solver.solve(solver.factorise(operator), right)
    assert primitive.rebuild_count() - before == 1
    Pardiso({20: 1}).factorise(operator)
    assert primitive.rebuild_count() - before == 2


def test_pardiso_factorises_each_matrix_once(monkeypatch):
    """A solve that finds its own factor in place goes straight to the substitution."""
    primitive = pytest.importorskip("pardiso_mkl_jax.primitive")
    calls = []
    native = primitive.factor_and_solve_stateful

    def counted(token, indptr, indices, values, right, **rest):
        jax.debug.callback(lambda _: calls.append(1), values[0])
        return native(token, indptr, indices, values, right, **rest)

    monkeypatch.setattr(primitive, "factor_and_solve_stateful", counted)
    operator, right = system(n=31, seed=12)
    solver = Pardiso({20: 1})  # not compiled before

    @jax.jit
    def several(operator, right):
        def turn(state):
            count, right = state
            factor = solver.factorise(operator.shifted(1.0 * count))
            return count + 1, solver.solve(factor, solver.solve(factor, right))

        return jax.lax.while_loop(lambda state: state[0] < 4, turn, (0, right))[1]

    jax.block_until_ready(several(operator, right))
    jax.effects_barrier()
    assert len(calls) == 4


def test_sparsax_factorises_each_matrix_once():
    sparsax = pytest.importorskip("sparsax")
    operator, right = system(n=37, seed=11)
    solver = Cholmod()
    before, patterns = sparsax.factorization_count(), sparsax.cache_size()
    for shift in range(3):
        factor = solver.factorise(operator.shifted(float(shift)))
        solver.solve(factor, solver.solve(factor, right))
    assert sparsax.factorization_count() - before == 3
    assert sparsax.cache_size() - patterns == 1


def test_superlu_orders_a_pattern_once_and_keeps_few_factors(monkeypatch):
    from shellkit._solve.linear import superlu

    orderings, decompositions = [], []
    order, decompose = superlu._order, superlu._decompose
    monkeypatch.setattr(superlu, "_order", lambda *a: orderings.append(1) or order(*a))
    monkeypatch.setattr(superlu, "_decompose", lambda *a: decompositions.append(1) or decompose(*a))
    operator, right = system(n=37, seed=11)
    solver = SuperLU()
    first = solver.factorise(operator)
    for shift in range(superlu._CACHED):
        solver.solve(solver.factorise(operator.shifted(shift + 1.0)), right).block_until_ready()
    assert (len(orderings), len(decompositions)) == (1, 1 + superlu._CACHED)
    np.testing.assert_allclose(solver.solve(first, right), dense_solution(operator, right), atol=1e-13)
    assert len(decompositions) == 2 + superlu._CACHED
    assert len(superlu._factors.entries) == superlu._CACHED


@every_solver
def test_soft_and_stiff_unknowns_together(solver):
    """Sixteen orders of magnitude between them, as between stretching and bending of a sheet of h = 1e-8, cost no
    digits."""
    operator, right = system(seed=3)
    scale = jnp.logspace(0, -8, 40)
    pattern = operator.pattern
    scaled = SparseSymmetric(pattern, operator.values * scale[pattern.rows] * scale[pattern.indices])
    factor = solver.factorise(scaled)
    assert bool(factor.ok) and int(factor.negative) == 0
    found = scale * solver.solve(factor, scale * right)
    np.testing.assert_allclose(found, dense_solution(operator, right), rtol=0, atol=1e-13)


@every_solver
def test_single_precision_is_refused(solver):
    operator, _ = system()
    single = SparseSymmetric(operator.pattern, operator.values.astype(jnp.float32))
    with pytest.raises(ValueError, match=r"float64.*float32.*jax_enable_x64"):
        solver.factorise(single)


@every_solver
def test_shapes_and_operators_are_checked(solver):
    operator, right = system()
    with pytest.raises(ValueError, match=r"shape \(39,\): expected \(40,\)"):
        solver.solve(solver.factorise(operator), right[:39])
    with pytest.raises(ValueError, match="SparseSymmetric operator, not MatrixLinearOperator"):
        lx.linear_solve(lx.MatrixLinearOperator(operator.as_matrix()), right, solver)


def test_choice_of_solver(monkeypatch):
    monkeypatch.delenv("SHELLKIT_SOLVER", raising=False)
    assert isinstance(linear_solver("superlu"), SuperLU)
    with pytest.raises(ValueError, match=r"no solver 'umfpack'.*'pardiso'"):
        linear_solver("umfpack")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "pardiso_mkl_jax" else name)
    with pytest.raises(ImportError, match="pip install pardiso-mkl-jax"):
        linear_solver("pardiso")
    monkeypatch.setattr(jax, "default_backend", lambda: "cpu")
    assert isinstance(default_linear_solver(), Cholmod)
    monkeypatch.setenv("SHELLKIT_SOLVER", "superlu")
    assert isinstance(default_linear_solver(), SuperLU)
