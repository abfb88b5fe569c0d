"""Held volumes and areas against closed forms, balance of forces and finite differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

import shellkit as sk
from shellkit import AreaConstraint, Inflation, VolumeConstraint
from shellkit._energy import Assembly, DiscreteEnergy
from shellkit._rest import RestShape
from shellkit._solve.linear.bordered import Bordered, BorderedSolver
from shellkit._solve.linear.superlu import SuperLU
from shellkit._solve.matrices.operator import SparseSymmetric
from shellkit._solve.matrices.pattern import SymmetricPattern


BALL = sk.meshes.icosphere(subdivisions=0)
VOLUME = float(sk.enclosed_volume(BALL.vertices, BALL))
AREA = float(sk.surface_area(BALL.vertices, BALL))
THICKNESS, SHEAR = 0.05, 2.0


def balloon(factor, stretch):
    """Rubber on an icosahedron, which stays one: E = ½ μ h A (2ρ² + ρ⁻⁴ − 3) is exact on its flat faces."""
    rubber = sk.IncompressibleNeoHookean(SHEAR)
    return sk.InverseProblem(BALL, THICKNESS, rubber + Inflation(factor), sk.IsotropicGrowth(stretch))


@pytest.fixture(scope="module")
def inflated():
    """Of a factor and a stretch per face: pressure, mixture of pressure and shape, derivatives of both, equilibrium."""

    @eqx.filter_jit
    def run(problem, factor, stretch):
        def measure(factor, stretch):
            changed = eqx.tree_at(lambda p: (p.energy.terms[1].factor, p.actuation.stretch), problem, (factor, stretch))
            equilibrium = changed()
            (pressure,) = equilibrium.multipliers
            return (pressure, jnp.sum(jnp.sin(3 * equilibrium.vertices)) + 7 * pressure), equilibrium

        (pressure, mixture), pull, equilibrium = jax.vjp(measure, factor, stretch, has_aux=True)
        one, zero = jnp.ones(()), jnp.zeros(())
        return pressure, mixture, pull((one, zero)), pull((zero, one)), equilibrium

    problem = balloon(1.0, jnp.ones(BALL.n_faces))
    return lambda factor, stretch: run(problem, jnp.asarray(factor), stretch)


@pytest.mark.parametrize("radius", [1.2, 2.0])
def test_rubber_balloon_on_both_sides_of_its_greatest_pressure(inflated, radius):
    """p = dE/dV; the greatest is at ρ = 7^(1/6) = 1.383, beyond which no given pressure is stable, but a volume is."""
    pressure, _, (slope, _), _, equilibrium = inflated(radius**3, jnp.ones(BALL.n_faces))
    assert equilibrium.converged and equilibrium.stable
    np.testing.assert_allclose(equilibrium.vertices, radius * BALL.vertices, atol=1e-10)
    volume = float(sk.enclosed_volume(equilibrium.vertices, BALL))
    np.testing.assert_allclose(volume, radius**3 * VOLUME, rtol=1e-13)
    unit = 2 * SHEAR * THICKNESS * AREA / (3 * VOLUME)
    np.testing.assert_allclose(pressure, unit * (1 / radius - radius**-7), rtol=1e-10)
    # dp/df with f = ρ³
    np.testing.assert_allclose(slope, unit * (7 * radius**-8 - radius**-2) / (3 * radius**2), rtol=1e-9)


def test_derivatives_of_shape_and_pressure_against_differences(inflated):
    rng = np.random.default_rng(0)
    stretch = jnp.asarray(1 + 0.05 * rng.normal(size=BALL.n_faces))
    way = jnp.asarray(rng.normal(size=BALL.n_faces))
    *_, (by_factor, by_stretch), equilibrium = inflated(1.8, stretch)
    assert equilibrium.converged
    step = 1e-4
    ahead, back = (inflated(1.8 + s, stretch + 0.5 * s * way)[1] for s in (step, -step))
    np.testing.assert_allclose((ahead - back) / (2 * step), by_factor + 0.5 * by_stretch @ way, rtol=1e-6)


def test_a_vesicle_holds_its_area_and_squeezes_what_is_in_it():
    """An area held exactly and a volume on a spring: forces balance, and each multiplier is what it is said to be."""
    stiffness = 0.3
    skin = sk.StVenantKirchhoff(1.0, 1.0) + AreaConstraint(0.9 * AREA) + VolumeConstraint(stiffness=stiffness)
    equilibrium = sk.InverseProblem(BALL, THICKNESS, skin)()
    assert equilibrium.converged
    shape = equilibrium.vertices
    push, pressure = np.asarray(equilibrium.multipliers)
    np.testing.assert_allclose(sk.surface_area(shape, BALL), 0.9 * AREA, rtol=1e-13)
    np.testing.assert_allclose(pressure, -stiffness * (sk.enclosed_volume(shape, BALL) - VOLUME), rtol=1e-10)
    # Shrunk evenly, by ρ² = 0.9: h A (α + β)(ρ² − 1)² + ½ k (ρ³ − 1)² V², whose derivative in the area is the force.
    scale = np.sqrt(0.9)
    np.testing.assert_allclose(shape, scale * BALL.vertices, atol=1e-9)
    elastic = THICKNESS * AREA * 2.0 * 2 * (scale**2 - 1) * 2 * scale
    spring = stiffness * (scale**3 - 1) * VOLUME * 3 * scale**2 * VOLUME
    np.testing.assert_allclose(push, (elastic + spring) / (2 * scale * AREA), rtol=1e-8)


def test_constraints_add_no_nonzeros():
    ball = sk.meshes.icosphere(subdivisions=2)
    skin = sk.StVenantKirchhoff(1.0, 1.0)
    both = skin + VolumeConstraint() + AreaConstraint()
    bare, held = (Assembly.of(e, ball) for e in (skin, both))
    assert held.pattern.nnz == bare.pattern.nnz
    n = 3 * ball.n_vertices
    energy = DiscreteEnergy(both, ball, RestShape.of(ball, jnp.array(0.1), None), held, jnp.zeros(n))
    made = jax.make_jaxpr(lambda y: energy.derivatives(y))(ball.vertices.reshape(-1))
    largest = max(v.aval.size for equation in made.jaxpr.eqns for v in equation.outvars)
    assert largest < n**2 / 4


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_bordered_systems_against_dense_ones(sign):
    """Solutions, and the number of directions of negative curvature, where the sparse part is definite and is not."""
    rng = np.random.default_rng(1)
    n, m = 9, 2
    dense = rng.normal(size=(n, n))
    dense = dense @ dense.T + np.eye(n)
    vectors = np.linalg.eigh(dense)[1]
    dense = dense if sign > 0 else dense - (dense @ vectors[:, :1] * 3) @ vectors[:, :1].T
    rows, columns = np.triu_indices(n)
    pattern, positions = SymmetricPattern.of(rows, columns, n)
    values = jnp.zeros(pattern.nnz).at[positions].set(dense[rows, columns])
    border = jnp.asarray(np.vstack([5 * vectors[:, 0] + 0.1 * vectors[:, 3], rng.normal(size=n)]))
    solver, rhs = BorderedSolver(SuperLU()), jnp.asarray(rng.normal(size=n + m))
    for compliances, eliminated in (([0.01, 0.1], True), ([0.01, 0.1], False), ([0.0, 0.0], False)):
        operator = Bordered(SparseSymmetric(pattern, values), border, jnp.asarray(compliances), eliminated)
        factor, right = solver.factorise(operator), rhs[:n] if eliminated else rhs
        assert factor.ok
        solution = solver.solve(factor, right)
        np.testing.assert_allclose(operator.as_matrix() @ solution, right, atol=1e-10)
        np.testing.assert_allclose(operator.mv(solution), right, atol=1e-10)
        if compliances[0] > 0:
            reduced = dense + np.asarray(border.T / jnp.asarray(compliances)) @ np.asarray(border)
        else:
            unseen = np.linalg.svd(border)[2][m:]
            reduced = unseen @ dense @ unseen.T
        assert int(factor.negative) == np.count_nonzero(np.linalg.eigvalsh(reduced) < 0)


class Heights(sk.EnergyTerm):
    def stencil(self, mesh):
        return jnp.arange(mesh.n_vertices)[:, None]

    def element_energy(self, x, data):
        return x[0, 2]


class TotalHeight(sk.Constraint):
    value: Array
    stiffness: Array | None = None
    progress: float = 1.0

    def measure(self):
        return Heights()

    def target(self, at_rest):
        return at_rest + self.progress * (self.value - at_rest)


def test_a_constraint_of_ones_own_moves_a_sheet_on_springs():
    sheet = sk.meshes.rectangle(length=1.0, width=1.0, cells=(2, 2))
    energy = sk.StVenantKirchhoff(1.0, 1.0) + sk.Foundation(4.0) + TotalHeight(value=jnp.asarray(0.9))
    equilibrium = sk.InverseProblem(sheet, 0.1, energy)()
    assert equilibrium.converged
    np.testing.assert_allclose(jnp.sum(equilibrium.vertices[:, 2]), 0.9, rtol=1e-13)
    # Forces p on each vertex: together they are those of the springs.
    areas = sk.vertex_areas(sheet.vertices, sheet)
    np.testing.assert_allclose(
        9 * np.sum(np.asarray(equilibrium.multipliers)), 4.0 * areas @ equilibrium.vertices[:, 2], rtol=1e-9
    )


def test_refusals():
    sheet = sk.meshes.rectangle(length=1.0, width=1.0, cells=(2, 2))
    skin = sk.StVenantKirchhoff(1.0, 1.0)
    with pytest.raises(ValueError, match="surface is open"):
        sk.InverseProblem(sheet, 0.1, skin + Inflation(2.0))
    with pytest.raises(ValueError, match="point inwards"):
        Inflation(2.0).check(sk.Mesh(BALL.vertices, BALL.faces[:, ::-1]))
    with pytest.raises(ValueError, match="factor is -1"):
        Inflation(-1.0).check(BALL)
    with pytest.raises(ValueError, match="has no weight"):
        sk.InverseProblem(BALL, 0.1, skin + 2.0 * VolumeConstraint())
    with pytest.raises(ValueError, match="SparseNewton only"):
        import optimistix as optx

        sk.InverseProblem(BALL, 0.1, skin + VolumeConstraint(), solver=optx.BFGS(1e-8, 1e-8))
    with pytest.raises(ValueError, match="stiffness is 0"):
        sk.InverseProblem(BALL, 0.1, skin + VolumeConstraint(stiffness=0.0))
    with pytest.raises(ValueError, match="not sparse"):
        sk.InverseProblem(BALL, 0.1, skin + VolumeConstraint()).hessian(BALL.vertices)
