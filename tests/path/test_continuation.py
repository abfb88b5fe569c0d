"""Paths through limit points and bifurcations against the two bars of von Mises, whose equilibria are known."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

import shellkit as sk


class Bars(sk.EnergyTerm):
    """Two bars from feet to an apex: Σ ½ S ℓ₀ e² with Green's strain e = (ℓ² − ℓ₀²) / 2ℓ₀²."""

    stiffness: Array

    def stencil(self, mesh):
        return np.array([[0, 2], [1, 2]])

    def element_data(self, mesh, rest):
        return jnp.linalg.norm(mesh.vertices[:2] - mesh.vertices[2], axis=1)

    def element_energy(self, x, length):
        strain = (jnp.sum((x[0] - x[1]) ** 2) - length**2) / (2 * length**2)
        return 0.5 * self.stiffness * length * strain**2


STIFFNESS = 3.0


def truss(half_span, height, load):
    """Feet at ±a, the apex at height H, free in the plane of the bars and pressed down."""
    mesh = sk.Mesh(
        jnp.array([[-half_span, 0.0, 0.0], [half_span, 0.0, 0.0], [0.0, 0.0, height]]), jnp.array([[0, 1, 2]])
    )
    return sk.InverseProblem(
        mesh,
        1.0,
        Bars(jnp.asarray(STIFFNESS)) + sk.PointLoad([2], [0.0, 0.0, -load]),
        supports=sk.Pinned([0, 1]) + sk.Sliding([2], normal="y"),
    )


def force(half_span, height, z):
    """P(z) = S (H² − z²) z / ℓ₀³ with the apex on the axis, twice half of it."""
    return STIFFNESS * (height**2 - z**2) * z / (half_span**2 + height**2) ** 1.5


@pytest.fixture(scope="module")
def shallow():
    greatest = force(2.0, 1.0, 1 / np.sqrt(3))
    return greatest, sk.trace(truss(2.0, 1.0, 1.5 * greatest), sk.ArcLength(first=0.05, steps=100))


def test_a_shallow_roof_is_followed_through_both_its_limit_points(shallow):
    greatest, branch = shallow
    assert branch.complete and float(branch.progress[-1]) == 1.0
    x, _, z = branch.vertices[:, 2].T
    np.testing.assert_allclose(x, 0.0, atol=1e-12)
    np.testing.assert_allclose(force(2.0, 1.0, z), branch.progress * 1.5 * greatest, atol=1e-10)
    assert [point.kind for point in branch.critical] == ["limit point"] * 2
    for point, sign in zip(branch.critical, (1, -1), strict=True):
        np.testing.assert_allclose(point.progress, sign / 1.5, rtol=1e-9)
        np.testing.assert_allclose(point.equilibrium.vertices[2], [0, 0, sign / np.sqrt(3)], atol=1e-6)
        np.testing.assert_allclose(jnp.abs(point.mode[2]), [0, 0, 1], atol=1e-6)


def test_pivots_tell_stability_on_the_way(shallow):
    _, branch = shallow
    z = branch.vertices[:, 2, 2]
    np.testing.assert_array_equal(branch.negative, jnp.where(jnp.abs(z) < 1 / np.sqrt(3), 1, 0))
    np.testing.assert_array_equal([at.stable for at in branch.equilibria], branch.negative == 0)
    assert len(str(branch).splitlines()) == 1 + len(z) + 2


def test_a_steep_roof_leans_over_at_a_bifurcation():
    """E_xx vanishes on the axis at z² = H² − 2a²; the path that crosses there is the circle x² + z² = H² − 2a², on
    which P = 2 S a² z / ℓ₀³."""
    half, height = 1.0, 2.0
    greatest = force(half, height, height / np.sqrt(3))
    problem = truss(half, height, 1.2 * greatest)
    branch = sk.trace(problem, sk.ArcLength(first=0.05, steps=100))
    assert branch.complete
    kinds = [point.kind for point in branch.critical]
    assert kinds == ["bifurcation", "limit point", "limit point", "bifurcation"]
    first = branch.critical[0]
    z = np.sqrt(height**2 - 2 * half**2)
    np.testing.assert_allclose(first.progress, force(half, height, z) / (1.2 * greatest), rtol=1e-7)
    np.testing.assert_allclose(jnp.abs(first.mode[2]), [1, 0, 0], atol=1e-5)
    for size in (0.1, -0.1):
        side = sk.switch_branch(problem, first, size, sk.ArcLength(steps=12))
        x, _, z = side.vertices[:, 2].T
        assert len(x) > 5 and float(jnp.min(x * np.sign(size))) > 0.09
        np.testing.assert_allclose(x**2 + z**2, height**2 - 2 * half**2, rtol=1e-9)
        exact = 2 * STIFFNESS * half**2 * z / (half**2 + height**2) ** 1.5
        np.testing.assert_allclose(side.progress * 1.2 * greatest, exact, atol=1e-10)


def test_shapes_that_a_shallow_roof_can_take():
    problem = truss(2.0, 1.0, 0.0)
    found = sk.distinct_equilibria(problem, starts=12, noise=0.6, seed=1)
    heights = sorted(float(at.vertices[2, 2]) for at in found.equilibria)
    np.testing.assert_allclose(heights, [-1.0, 1.0], atol=1e-9)
    assert all(bool(at.stable) for at in found.equilibria) and sum(found.found) + len(found.failures) == 13
    np.testing.assert_allclose([at.energy for at in found.equilibria], 0.0, atol=1e-18)
    assert "stable" in str(found)


def test_refusals():
    problem = truss(2.0, 1.0, 0.1)
    with pytest.raises(ValueError, match="cannot be traced by JAX"):
        eqx.filter_jit(lambda p: sk.trace(p).progress)(problem)
    with pytest.raises(ValueError, match="must be positive"):
        sk.ArcLength(first=0.0)
    ball = sk.meshes.icosphere(subdivisions=0)
    held = sk.InverseProblem(ball, 0.1, sk.StVenantKirchhoff(1.0, 1.0) + sk.VolumeConstraint())
    with pytest.raises(ValueError, match="constraints"):
        sk.trace(held)
