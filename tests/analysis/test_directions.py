"""The algebra of identifiability, on given derivatives: decompositions in full and of the leading part, and what is
made of them. No shell is relaxed."""

import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk
from shellkit._analysis.identifiability import _Derivative, _in_full, _leading


MESH = sk.meshes.icosphere(subdivisions=0)
SHELL = sk.InverseProblem(mesh=MESH, thickness=0.1, energy=sk.StVenantKirchhoff(1.0, 1.0))


class Given(_Derivative):
    """Products with a matrix, counted."""

    def __init__(self, matrix):
        self.matrix, self.products = matrix, 0

    def forward(self, rows):
        self.products += len(rows)
        return rows @ self.matrix.T

    def backward(self, rows):
        self.products += len(rows)
        return rows @ self.matrix


def matrix(coordinates, parameters, rank, decay=0.03):
    rng = np.random.default_rng(coordinates + rank)
    sizes = np.exp(-decay * np.arange(rank))
    return (rng.normal(size=(coordinates, rank)) * sizes) @ rng.normal(size=(rank, parameters))


@pytest.mark.parametrize("coordinates, parameters", [(36, 20), (36, 50), (36, 36)])
def test_in_full(coordinates, parameters):
    given = matrix(coordinates, parameters, 15)
    left, sizes, right = _in_full(Given(given), parameters, coordinates)
    assert left.shape == (parameters, coordinates) and right.shape == (parameters, parameters)
    assert np.allclose(left.T @ (sizes[:, None] * right), given, atol=1e-12 * sizes[0])
    assert np.allclose(right @ right.T, np.eye(parameters), atol=1e-13)
    assert (np.diff(sizes) <= 0).all() and np.abs(sizes[15:]).max() < 1e-12 * sizes[0]


@pytest.mark.parametrize(
    "coordinates, parameters, rank", [(300, 500, 300), (500, 300, 200), (300, 500, 5), (20, 900, 20)]
)
def test_leading(coordinates, parameters, rank):
    given = Given(matrix(coordinates, parameters, rank))
    left, sizes, right = _leading(given, parameters, 12, min(22, coordinates), seed=0)
    exact = np.linalg.svd(given.matrix, compute_uv=False)
    found = min(12, rank)
    assert np.allclose(sizes[:found], exact[:found], rtol=1e-9) and (sizes[found:] < 1e-12 * exact[0]).all()
    assert np.allclose(left @ left.T, np.eye(len(left)), atol=1e-12)
    assert np.allclose(given.matrix @ right[:found].T, (sizes[:, None] * left)[:found].T, atol=1e-6 * exact[0])
    # Less work than forming the matrix, where it is large.
    assert given.products < min(coordinates, parameters) or coordinates < 100


def test_leading_of_nothing():
    left, sizes, right = _leading(Given(np.zeros((36, 50))), 50, 4, 14, seed=0)
    assert not left.any() and not sizes.any() and np.allclose(right @ right.T, np.eye(4))


@pytest.fixture
def insight():
    """A derivative in two arrays, of three and of 2 x 5 numbers, the second in units of a tenth."""
    given = matrix(36, 13, 13)
    left, sizes, right = _in_full(Given(given), 13, 36)
    return given, sk.Identifiability(
        singular_values=jnp.asarray(sizes),
        directions={"a": jnp.asarray(right[:, :3]), "b": jnp.asarray(right[:, 3:]).reshape(-1, 2, 5)},
        shapes=jnp.asarray(np.sqrt(12) * left.reshape(-1, 12, 3)),
        scale={"a": jnp.ones(3), "b": 0.1 * jnp.ones((2, 5))},
        equilibrium=SHELL.unrelaxed(),
        complete=True,
    )


def test_displacement_and_parts(insight):
    given, result = insight
    rng = np.random.default_rng(1)
    change = {"a": rng.normal(size=3), "b": rng.normal(size=(2, 5))}
    together = np.concatenate([change["a"], 10 * change["b"].ravel()])
    assert np.allclose(np.ravel(result.displacement(change)), np.sqrt(12) * given @ together, rtol=1e-10)
    assert np.allclose(result.seen(change, 0.0)["b"], change["b"])
    # The part seen and the rest are orthogonal, and the rest moves the shape by less than the threshold a unit.
    threshold = float(result.singular_values[6])
    seen = result.seen(change, threshold)
    rest = {name: change[name] - np.asarray(seen[name]) for name in change}
    assert np.allclose(result.components(rest)[:7], 0, atol=1e-12)
    size = np.sqrt((rest["a"] ** 2).sum() + (100 * rest["b"] ** 2).sum())
    assert np.linalg.norm(result.displacement(rest)) / np.sqrt(12) < threshold * size


def test_posterior_and_tolerance(insight):
    given, result = insight
    noise, prior = 3.0, 0.5
    jacobian = np.sqrt(12) * given
    exact = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian / noise**2 + np.eye(13) / prior**2)))
    found = result.posterior(noise, prior)
    assert np.allclose(found["a"], exact[:3], rtol=1e-9)
    assert np.allclose(np.ravel(found["b"]), 0.1 * exact[3:], rtol=1e-9)
    spread = 0.2 * np.sqrt((jacobian.reshape(12, 3, 13) ** 2).sum(axis=(1, 2)))
    assert np.allclose(result.tolerance(0.2), spread, rtol=1e-10)


def test_rank_and_words(insight):
    _, result = insight
    assert result.rank() == 13 and result.rank(2.0) == 0
    assert str(result).splitlines()[0] == "13 parameters, 36 coordinates of vertices"
    with pytest.raises(ValueError, match="change names 'c'"):
        result.components({"c": np.ones(3)})
    with pytest.raises(ValueError, match=r"change of b has shape \(10,\)"):
        result.components({"b": np.ones(10)})
