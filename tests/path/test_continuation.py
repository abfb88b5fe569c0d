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
    return greatest, sk.continue_path(truss(2.0, 1.0, 1.5 * greatest), sk.ArcLength(first=0.05, steps=100))


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
    branch = sk.continue_path(problem, sk.ArcLength(first=0.05, steps=100))
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


BALL = sk.meshes.icosphere(subdivisions=0)
VOLUME, AREA = (float(measure(BALL.vertices, BALL)) for measure in (sk.enclosed_volume, sk.surface_area))
UNIT = 2 * STIFFNESS * 0.05 * AREA / (3 * VOLUME)


def pressure(radius):
    """Of a rubber balloon of this shape, which stays an icosahedron: dE/dV of ½ μ h A (2ρ² + ρ⁻⁴ − 3)."""
    return UNIT * (1 / radius - radius**-7)


def balloon(held):
    return sk.InverseProblem(BALL, 0.05, sk.IncompressibleNeoHookean(STIFFNESS) + held)


def radii(branch):
    found = jnp.linalg.norm(branch.vertices, axis=2) / jnp.linalg.norm(BALL.vertices, axis=1)
    np.testing.assert_allclose(found, found[:, :1] * jnp.ones(BALL.n_vertices), rtol=1e-9)
    return found[:, 0]


def test_a_balloon_that_is_filled_passes_its_greatest_pressure():
    branch = sk.continue_path(balloon(sk.Inflation(6.0)), sk.ArcLength(first=0.1))
    assert branch.complete and not branch.critical
    rho = radii(branch)
    np.testing.assert_allclose(rho**3, 1 + 5 * branch.progress, rtol=1e-9)
    np.testing.assert_array_equal(branch.negative, 0)
    found = jnp.stack([at.multipliers[0] for at in branch.equilibria])
    np.testing.assert_allclose(found, pressure(rho), atol=1e-9 * UNIT)
    assert float(rho[jnp.argmax(found)]) < 1.6 < float(rho[-1])  # the greatest is at 7^(1/6) = 1.38


def test_a_balloon_filled_through_a_spring_snaps_where_it_should():
    """The fluid wanted, V₀ = V + p(V)/k, has a greatest and a least value on the way: limit points that are known."""
    stiffness, most = 0.012 * UNIT / VOLUME, 60.0
    wanted = lambda rho: rho**3 + pressure(rho) / stiffness / VOLUME
    branch = sk.continue_path(
        balloon(sk.VolumeConstraint(most * VOLUME, stiffness=stiffness)), sk.ArcLength(first=0.02, longest=3.0)
    )
    np.testing.assert_allclose(wanted(radii(branch)), 1 + (most - 1) * branch.progress, rtol=1e-9)
    fine = np.linspace(1.3, 3.0, 2_000_001)
    turning = fine[1:-1][np.diff(np.sign(np.diff(wanted(fine)))) != 0]
    limits = [point for point in branch.critical if point.kind == "limit point"]
    assert len(turning) == len(limits) == 2
    for rho, point in zip(turning, limits, strict=True):
        np.testing.assert_allclose(1 + (most - 1) * point.progress, wanted(rho), rtol=1e-9)


def test_refusals():
    problem = truss(2.0, 1.0, 0.1)
    with pytest.raises(ValueError, match="cannot be traced by JAX"):
        eqx.filter_jit(lambda p: sk.continue_path(p).progress)(problem)
    with pytest.raises(ValueError, match="must be positive"):
        sk.ArcLength(first=0.0)
