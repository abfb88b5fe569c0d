"""The way off a saddle: by itself, and in a shell that looks unstable until it has grown."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

import shellkit as sk
from shellkit._solve.saddle import away_from_saddle


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
    found = np.asarray(away_from_saddle(lambda v: convex @ v, lambda v: inverse @ v, gradient, jnp.asarray(0.25)))
    softest = -turn[:, 0] / np.max(np.abs(turn[:, 0]))
    np.testing.assert_allclose(found, 0.25 * softest, atol=1e-6)


def test_at_the_saddle_it_is_the_lowest_of_the_dense_problem():
    random = np.random.default_rng(0)
    turn = np.linalg.qr(random.normal(size=(40, 40)))[0]
    # The softest directions of the convex matrix are stable ones of the Hessian.
    hessian = turn @ np.diag(np.r_[-2.0, -0.5, np.full(8, 1e-3), np.linspace(1, 50, 30)]) @ turn.T
    convex = hessian + turn @ np.diag(np.r_[5.0, 4.0, np.zeros(38)]) @ turn.T
    inverse, rounding = jnp.asarray(np.linalg.inv(convex)), jnp.asarray(1e-12 * turn[:, 0])
    step = lambda gradient: away_from_saddle(lambda v: hessian @ v, lambda v: inverse @ v, gradient, jnp.asarray(1.0))
    found = np.asarray(step(rounding))
    lowest = scipy.linalg.eigh(hessian, convex)[0][0]
    assert np.isclose((found @ hessian @ found) / (found @ convex @ found), lowest, rtol=1e-3)
    np.testing.assert_array_equal(step(-rounding), found)


@pytest.mark.slow
def test_neighbouring_problems_stay_on_one_branch():
    """Springs under compression make the sphere at rest unstable; grown by nearly a tenth it is not, and round."""
    problem = sk.InverseProblem(
        mesh=sk.meshes.icosphere(subdivisions=2),
        thickness=0.05,
        energy=sk.NeoHookean.from_young(1.0, 0.3) + sk.Bending.from_young(1.0, 0.3) + 2.0 * Springs(jnp.asarray(3.0)),
    )
    radii = []
    for stiffness in (3.0, 3.0001):
        found = eqx.tree_at(lambda p: p.energy.terms[2].term.stiffness, problem, jnp.asarray(stiffness))()
        assert found.converged
        assert found.stable
        radii.append(float(jnp.linalg.norm(found.vertices - found.vertices.mean(axis=0), axis=1).mean()))
    assert 1.09 < radii[0] < 1.1
    assert abs(radii[1] - radii[0]) < 1e-6
