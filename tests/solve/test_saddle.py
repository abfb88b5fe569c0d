"""The way off a saddle: by itself, and in a shell that looks unstable until it has grown."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx

import shellkit as sk
from shellkit._solve.matrices.pattern import SymmetricPattern


class Springs(sk.EnergyTerm):
    """Edges that would like to be a tenth longer."""

    stiffness: jnp.ndarray

    def stencil(self, mesh):
        return mesh.edges

    def element_data(self, mesh, rest):
        return sk.edge_lengths(mesh.vertices, mesh)

    def element_energy(self, x, rest_length):
        return 0.5 * self.stiffness * (jnp.linalg.norm(x[0] - x[1]) - 1.1 * rest_length) ** 2


def test_the_way_off_a_saddle_is_soft_and_downhill():
    random = np.random.default_rng(0)
    turn = np.linalg.qr(random.normal(size=(40, 40)))[0]
    convex = turn @ np.diag(np.r_[0.1, np.linspace(1, 50, 39)]) @ turn.T
    inverse, gradient = jnp.asarray(np.linalg.inv(convex)), jnp.asarray(turn[:, 0] + turn[:, 30])
    escape = sk.SaddleEscape()
    found = np.asarray(escape.direction(lambda v: convex @ v, lambda v: inverse @ v, gradient, jnp.asarray(0.25)))
    softest = -turn[:, 0] / np.max(np.abs(turn[:, 0]))
    np.testing.assert_allclose(found, 0.25 * softest, atol=1e-6)


def chosen(lowest, softest, gradient, escape=sk.SaddleEscape()):
    """The step of a Hessian with these two eigenvalues below all others, a convex model with 3 for the first of them,
    and its curvature in proportion to the model's."""
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(40, 40)))[0]
    hessian = turn @ np.diag(np.r_[lowest, np.full(9, softest), np.linspace(5, 50, 30)]) @ turn.T
    convex = hessian + turn @ np.diag(np.r_[3.0 - lowest, np.zeros(39)]) @ turn.T
    inverse = jnp.asarray(np.linalg.inv(convex))
    slope = jnp.asarray(gradient * turn[:, 0])
    step = np.asarray(escape.direction(lambda v: hessian @ v, lambda v: inverse @ v, slope, jnp.asarray(1.0)))
    return step, (step @ hessian @ step) / (step @ convex @ step)


def test_it_is_the_lowest_direction_where_the_energy_falls_most():
    for gradient in (1e-12, 0.1):
        curvature = chosen(-2.0, 1e-3, gradient)[1]
        assert np.isclose(curvature, -2 / 3, rtol=1e-3)
    downhill, uphill = (chosen(-2.0, 1e-3, gradient)[0] for gradient in (-0.1, 0.1))
    np.testing.assert_allclose(downhill, -uphill, rtol=1e-9)
    # A slope of rounding does not decide where to.
    np.testing.assert_array_equal(*(chosen(-2.0, 1e-3, gradient)[0] for gradient in (-1e-12, 1e-12)))


def test_a_weak_instability_is_followed_only_once_forces_balance():
    assert np.isclose(chosen(-0.5, 2.0, 0.1)[1], 1.0, rtol=1e-2)
    assert np.isclose(chosen(-0.5, 2.0, 1e-12)[1], -0.5 / 3, rtol=1e-3)
    # What is balance, and what is rounding, is up to its numbers.
    assert np.isclose(chosen(-0.5, 2.0, 0.1, sk.SaddleEscape(balance=10.0))[1], -0.5 / 3, rtol=1e-3)
    ways = [chosen(-2.0, 1e-3, gradient, sk.SaddleEscape(slope=10.0))[0] for gradient in (-0.1, 0.1)]
    np.testing.assert_allclose(*ways, rtol=1e-9)


def from_the_saddle(**parts):
    """The minimum of x² - y² + y⁴ from the origin, where no force acts; it is at (0, ±½√2)."""
    pattern = SymmetricPattern.of(np.arange(2), np.arange(2), 2)[0]
    hessian = lambda y: sk.SparseSymmetric(pattern, jnp.stack([jnp.asarray(2.0), -2 + 12 * y[1] ** 2]))
    return optx.minimise(
        lambda y, _: y[0] ** 2 - y[1] ** 2 + y[1] ** 4,
        sk.SparseNewton(**parts),
        jnp.zeros(2),
        options={"hessian": hessian},
        throw=False,
    )


def test_a_saddle_is_left_for_the_minimum_and_not_without_an_escape():
    found = from_the_saddle()
    assert found.result == optx.RESULTS.successful
    np.testing.assert_allclose(np.abs(found.value), [0, np.sqrt(0.5)], atol=1e-12)
    stays = from_the_saddle(saddle_escape=None)
    assert stays.result != optx.RESULTS.successful
    np.testing.assert_array_equal(stays.value, np.zeros(2))


def test_compressed_springs_grow_a_sphere_at_once():
    """At rest it is unstable, as they are compressed; grown it is not, and round. What springs have of negative
    curvature is taken away from each: nothing is led astray on the way, whatever rounding says."""
    problem = sk.InverseProblem(
        mesh=sk.meshes.icosphere(subdivisions=2),
        thickness=0.05,
        energy=sk.NeoHookean.from_young(1.0, 0.3) + sk.Bending.from_young(1.0, 0.3) + 2.0 * Springs(jnp.asarray(3.0)),
    )
    mean = []
    for stiffness in (3.0, 3.00000001, 3.0001):
        found = eqx.tree_at(lambda p: p.energy.terms[2].term.stiffness, problem, jnp.asarray(stiffness))()
        assert found.converged
        assert found.stable
        assert found.steps < 8
        radii = jnp.linalg.norm(found.vertices - found.vertices.mean(axis=0), axis=1)
        assert jnp.ptp(radii) < 0.02
        mean.append(float(radii.mean()))
    assert 1.09 < mean[0] < 1.1
    np.testing.assert_allclose(mean, mean[0], atol=1e-6)
