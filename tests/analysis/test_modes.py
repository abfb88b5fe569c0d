"""Modes of vibration against dense decompositions, and against the exact spectrum of a spherical shell."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

import shellkit as sk


def shell(mesh, thickness, directors="average", stretch=1.0):
    return sk.InverseProblem(
        mesh=mesh,
        thickness=thickness,
        actuation=sk.IsotropicGrowth(stretch=stretch),
        energy=sk.StVenantKirchhoff.from_young(young=1.0, poisson=0.3)
        + sk.Bending.from_young(young=1.0, poisson=0.3, directors=directors),
    )


def masses(mesh):
    """A third of the area of its faces to each vertex, once for each coordinate."""
    x = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    areas = 0.5 * np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1)
    lumped = np.zeros(mesh.n_vertices)
    np.add.at(lumped, np.asarray(mesh.faces), areas[:, None] / 3)
    return np.repeat(lumped, 3)


def dense(problem, vertices):
    """All eigenvalues, massless unknowns condensed."""
    stiffness = np.asarray(problem.hessian(vertices).as_matrix())
    n = 3 * problem.mesh.n_vertices
    if len(stiffness) > n:
        massless = np.linalg.solve(stiffness[n:, n:], stiffness[n:, :n])
        stiffness = stiffness[:n, :n] - stiffness[:n, n:] @ massless
    return scipy.linalg.eigh(stiffness, np.diag(masses(problem.mesh)), eigvals_only=True)


@pytest.fixture(scope="module")
def problem():
    return shell(sk.meshes.icosphere(subdivisions=2), 0.1)


@pytest.fixture(scope="module")
def modes(problem):
    return sk.vibration_modes(problem, count=20)


def test_eigenvalues_are_those_of_a_dense_decomposition(problem, modes):
    np.testing.assert_allclose(modes.eigenvalues, dense(problem, problem.mesh.vertices)[:20], atol=1e-13)


def test_modes_are_orthonormal_and_solve_the_equation(problem, modes):
    shapes, mass = np.asarray(modes.modes).reshape(20, -1), masses(problem.mesh)
    np.testing.assert_allclose(shapes * mass @ shapes.T, np.eye(20), atol=1e-12)
    stiffness = np.asarray(problem.hessian(problem.mesh.vertices).as_matrix())
    np.testing.assert_allclose(stiffness @ shapes.T, (mass * shapes).T * np.asarray(modes.eigenvalues), atol=1e-12)
    assert modes.converged and modes.directors is None and (modes.errors < 1e-13).all()


def test_a_free_shell_has_six_modes_of_no_stiffness(modes):
    np.testing.assert_allclose(modes.eigenvalues[:6], 0.0, atol=1e-12)
    assert modes.eigenvalues[6] > 1e-2


def test_a_table_of_the_modes(modes):
    assert len(str(modes).splitlines()) == 21


@pytest.mark.parametrize(
    ("thickness", "quadrupole", "octupole"), [(0.1, 0.0550320713, 0.0836532478), (0.01, 0.00540011765, 0.00757736742)]
)
def test_spectrum_of_a_sphere(thickness, quadrupole, octupole):
    """The exact multiplets of a spherical shell of unit radius (n = 2, five modes, and n = 3, seven)."""
    values = sk.vibration_modes(shell(sk.meshes.icosphere(subdivisions=3), thickness), count=18).eigenvalues
    np.testing.assert_allclose(values[:6], 0.0, atol=1e-12)
    np.testing.assert_allclose(values[6:11], quadrupole, rtol=4e-3)
    np.testing.assert_allclose(values[11:18], octupole, rtol=4e-3)


def test_an_unstable_shape_has_negative_eigenvalues(problem):
    """A sphere that wants to grow, but has not yet: its faces are under pressure, which softens it."""
    grown = eqx.tree_at(lambda p: p.actuation.stretch, problem, jnp.asarray(1.5))
    modes = sk.vibration_modes(grown, count=12, equilibrium=problem.unrelaxed())
    assert modes.eigenvalues[0] < -1e-3
    np.testing.assert_allclose(modes.eigenvalues, dense(grown, grown.mesh.vertices)[:12], atol=1e-11)


@pytest.mark.slow
def test_what_is_held_stays_so_in_the_modes():
    """A shell blown up to a volume, its skin on a spring: against a dense decomposition of the Hessian of energy,
    springs and multipliers on all motions that keep the volume."""
    mesh = sk.meshes.icosphere(subdivisions=1)
    volume, area = (float(measure(mesh.vertices, mesh)) for measure in (sk.enclosed_volume, sk.surface_area))
    bare = shell(mesh, 0.1)
    stiffness = 0.01
    held = sk.VolumeConstraint(1.2 * volume) + sk.AreaConstraint(0.9 * area, stiffness=stiffness)
    equilibrium = sk.InverseProblem(mesh, 0.1, bare.energy + held)()
    assert equilibrium.converged
    modes = sk.vibration_modes(sk.InverseProblem(mesh, 0.1, bare.energy + held), count=16, equilibrium=equilibrium)

    at = equilibrium.vertices
    pressure = float(equilibrium.multipliers[0])
    tension = stiffness * (float(sk.surface_area(at, mesh)) - 0.9 * area)
    forces = lambda x: -pressure * sk.enclosed_volume(x, mesh) + tension * sk.surface_area(x, mesh)
    n = at.size
    flat = lambda function: lambda y: function(y.reshape(-1, 3))
    hessian = np.asarray(bare.hessian(at).as_matrix()) + jax.hessian(flat(forces))(at.reshape(-1))
    by_volume, by_area = (
        np.asarray(jax.grad(flat(lambda x, measure=measure: measure(x, mesh)))(at.reshape(-1)))
        for measure in (sk.enclosed_volume, sk.surface_area)
    )
    hessian = hessian + stiffness * np.outer(by_area, by_area)
    keep = scipy.linalg.null_space(by_volume[None])
    mass = keep.T @ (masses(mesh)[:, None] * keep)
    exact = scipy.linalg.eigh(keep.T @ hessian @ keep, mass, eigvals_only=True)
    np.testing.assert_allclose(modes.eigenvalues, exact[:16], atol=1e-12)
    np.testing.assert_allclose(np.asarray(modes.modes).reshape(16, n) @ by_volume, 0.0, atol=1e-10)
    assert modes.converged


@pytest.mark.slow
def test_free_directors_follow_without_mass():
    plate = shell(sk.meshes.rectangle(length=1.0, width=0.8, cells=(4, 3)), 0.05, directors="free")
    modes = sk.vibration_modes(plate, count=15)
    np.testing.assert_allclose(modes.eigenvalues, dense(plate, plate.mesh.vertices)[:15], atol=1e-13)
    np.testing.assert_allclose(modes.eigenvalues[:6], 0.0, atol=1e-13)
    assert modes.directors.shape == (15, plate.mesh.n_edges)
    image = plate.hessian(plate.mesh.vertices).mv((modes.modes[8], modes.directors[8]))
    np.testing.assert_allclose(image[1], 0.0, atol=1e-14)


@pytest.mark.parametrize("count", [0, 100])
def test_a_count_out_of_range_is_refused(count):
    tetrahedra = shell(sk.meshes.icosphere(subdivisions=1), 0.1)
    with pytest.raises(ValueError, match=f"count={count}, but it must be between 1 and 60"):
        sk.vibration_modes(tetrahedra, count=count)
