"""Energy and stress of each face, against sums and states that are known."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk


def at_shape(problem, vertices):
    """An equilibrium as it would be reported at a shape, which need not be one."""
    return eqx.tree_at(lambda e: e.vertices, problem.unrelaxed(), vertices)


@pytest.fixture(scope="module")
def ball():
    return sk.meshes.icosphere(subdivisions=1)


def test_densities_sum_to_the_energy(ball):
    angle = jnp.linspace(0.0, 3.0, ball.n_faces)
    layer = sk.Nematic(angle=angle, stretch=1.2)
    energy = sk.NeoHookean(2.0, 1.0) + 3.0 * sk.Bending(1.0, 0.5, form="tan") + 0.5 * sk.StVenantKirchhoff(1.0, 1.0)
    problem = sk.InverseProblem(ball, 0.2, energy, actuation=sk.Bilayer(layer, sk.IsotropicGrowth(1.1)))
    vertices = ball.vertices * jnp.array([0.9, 1.0, 1.3]) + 0.03 * jnp.sin(7 * ball.vertices[:, ::-1])
    equilibrium = at_shape(problem, vertices)
    areas = 0.5 * np.sqrt(np.linalg.det(equilibrium.rest.metric))
    total = float(areas @ np.asarray(sk.energy_density(problem, equilibrium)))
    assert total == pytest.approx(float(problem.total_energy(vertices)), rel=1e-12)


def test_stress_of_a_sheet_pulled_one_way():
    """Plane stress: pulled along a director at 30 degrees, sigma = E eps along it and none across."""
    sheet = sk.meshes.rectangle(2.0, 1.0, cells=(4, 3), diagonals="jittered")
    young, poisson, strain = 3.0, 0.3, 1e-6
    problem = sk.InverseProblem(sheet, 0.1, sk.StVenantKirchhoff.from_young(young, poisson) + sk.Bending(1.0, 1.0))
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    pull = turn @ np.diag([1 + strain, 1 - poisson * strain, 1]) @ turn.T
    found = sk.membrane_stress(problem, at_shape(problem, sheet.vertices @ jnp.asarray(pull)))
    frames = np.stack(sk.face_frames(sheet.vertices, sheet), axis=1)[:, :, :2]
    exact = turn[:2, :2] @ np.diag([young * strain, 0]) @ turn[:2, :2].T
    in_space = np.einsum("fai,fab,fbj->fij", frames, found, frames)
    np.testing.assert_allclose(in_space, np.broadcast_to(exact, in_space.shape), atol=1e-5 * young * strain)


def test_work_of_the_stress_is_the_change_of_energy(ball):
    """For any small motion: dE = sum A h sigma : D, with D the rate of deformation in the frame of the face."""
    problem = sk.InverseProblem(ball, 0.2, sk.NeoHookean(2.0, 1.0), actuation=sk.IsotropicGrowth(1.2))
    vertices = ball.vertices * jnp.array([0.9, 1.0, 1.3])
    rate = jnp.sin(5 * ball.vertices[:, ::-1])
    step = 1e-6
    change = (problem.total_energy(vertices + step * rate) - problem.total_energy(vertices - step * rate)) / (2 * step)

    faces = np.asarray(ball.faces)
    edges = lambda x: np.stack([x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]]], axis=2)
    frames = np.stack(sk.face_frames(vertices, ball), axis=1)
    flat = frames @ edges(np.asarray(vertices))
    gradient = frames @ edges(np.asarray(rate)) @ np.linalg.inv(flat)
    stress = np.asarray(sk.membrane_stress(problem, at_shape(problem, vertices)))
    areas = 0.5 * np.linalg.det(flat)
    assert np.sum(0.2 * areas * np.einsum("fij,fij->f", stress, gradient)) == pytest.approx(float(change), rel=1e-7)
    np.testing.assert_allclose(stress, stress.transpose(0, 2, 1), atol=1e-15)
