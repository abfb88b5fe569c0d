"""Contact with planes and spheres: smoothness of the penalty, which motions it resists, and equilibria by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk
from shellkit._energy.loads.contact import Cushion


MESH = sk.meshes.icosphere(subdivisions=1)
ENERGY = sk.StVenantKirchhoff(alpha=1.0, beta=1.0) + sk.Bending(alpha=1.0, beta=1.0)


def test_penalty_is_a_cubic_and_then_a_parabola():
    stiffness, softness, distance, area = 3.0, 0.2, 0.05, 0.7
    energy = lambda gap: Cushion(stiffness, softness, distance).energy(jnp.asarray(gap), jnp.asarray(area))
    for depth in (-0.3, 0.0, 0.05, 0.199, 0.201, 1.0):
        gap = distance - depth
        if depth <= 0:
            expected = 0.0, 0.0, 0.0
        elif depth <= softness:
            expected = depth**3 / (6 * softness), depth**2 / (2 * softness), depth / softness
        else:
            expected = depth**2 / 2 - depth * softness / 2 + softness**2 / 6, depth - softness / 2, 1.0
        gap = jnp.asarray(gap)
        found = energy(gap), -jax.grad(energy)(gap), jax.grad(jax.grad(energy))(gap)
        assert np.allclose(found, stiffness * area * np.array(expected), rtol=1e-12, atol=1e-15)


def test_plane_measures_from_its_point_along_its_normal():
    """A sphere of radius one with the plane through its centre: the energy of each vertex by its height."""
    normal = np.array([1.0, 2.0, -0.5])
    plane = sk.PlaneContact(point=[0.1, 0.0, 0.2], normal=normal, stiffness=2.0, softness=0.3, distance=0.05)
    problem = sk.InverseProblem(mesh=MESH, thickness=0.1, energy=plane)
    depth = np.maximum(0.05 - (np.asarray(MESH.vertices) - [0.1, 0, 0.2]) @ normal / np.linalg.norm(normal), 0)
    each = np.where(depth < 0.3, depth**3 / 1.8, depth**2 / 2 - 0.15 * depth + 0.015)
    areas = np.asarray(sk.vertex_areas(MESH.vertices, MESH))
    assert np.isclose(float(problem.total_energy(MESH.vertices)), 2.0 * (each * areas).sum(), rtol=1e-12)


def test_a_plane_resists_three_motions_and_a_sphere_three():
    """Also where nothing touches them at rest."""
    plane = sk.PlaneContact([0.0, 0.0, -50.0], [0.0, 0.0, 1.0], stiffness=1.0, softness=0.1)
    sphere = sk.SphereContact([0.0, 0.0, -50.0], 1.0, stiffness=1.0, softness=0.1)
    at_rest = MESH.vertices.reshape(-1)
    for term, count in ((plane, 3), (sphere, 3)):
        motions = sk.InverseProblem(mesh=MESH, thickness=0.1, energy=ENERGY + term).rigid_modes()
        assert motions is not None
        assert np.count_nonzero(np.any(np.asarray(motions(at_rest)), axis=0)) == count
    motions = sk.InverseProblem(mesh=MESH, thickness=0.1, energy=ENERGY + plane).rigid_modes()
    fields = np.asarray(motions(at_rest)).reshape(MESH.n_vertices, 3, 6)
    # Translations in the plane and the rotation about its normal: nothing moves along it.
    assert np.abs(fields[:, 2]).max() < 1e-9


def test_a_shell_grows_into_a_mould():
    """A sphere swollen by λ inside a sphere of radius R: the penalty's pressure balances that of the shell, by hand."""
    stretch, h, k, softness = 1.2, 0.1, 40.0, 0.01
    mould = sk.SphereContact([0.0, 0.0, 0.0], 1.1, stiffness=k, softness=softness, inside=True)
    problem = sk.InverseProblem(
        mesh=MESH,
        thickness=h,
        actuation=sk.IsotropicGrowth(stretch),
        energy=sk.StVenantKirchhoff(alpha=1.0, beta=1.0) + mould,
    )
    equilibrium = problem()
    assert bool(equilibrium.converged) and bool(equilibrium.stable)
    area = float(sk.surface_area(MESH.vertices, MESH))

    # On a mesh that only changes its size both energies are functions of the radius ρ alone.
    from scipy.optimize import brentq

    def force(rho):
        shell = h / 4 * stretch**2 * area * 8 * 2 * (rho**2 / stretch**2 - 1) * 2 * rho / stretch**2
        depth = rho - 1.1
        return shell + k * area * (depth**2 / (2 * softness) if depth < softness else depth - softness / 2)

    rho = brentq(force, 1.1, 1.2, xtol=1e-14)
    radii = np.linalg.norm(equilibrium.vertices, axis=1)
    assert radii.mean() == pytest.approx(rho, abs=2e-3) and 1.1 < radii.min() < radii.max() < 1.13


def test_reaching_through_the_centre_is_finite():
    sphere = sk.SphereContact([0.0, 0.0, 0.0], 1.0, stiffness=1.0, softness=0.1)
    energy = lambda x: sphere.element_energy(x, jnp.asarray(1.0))
    at = jnp.zeros((1, 3))
    assert jnp.isfinite(energy(at)) and jnp.isfinite(jax.grad(energy)(at)).all()
    assert jnp.isfinite(jax.hessian(energy)(at)).all()


@pytest.mark.parametrize(
    "term, words",
    [
        (sk.PlaneContact([0, 0, 0], [0, 0, 0], 1.0, 0.1), "normal is zero"),
        (sk.PlaneContact([0, 0], [0, 0, 1], 1.0, 0.1), "point has shape"),
        (sk.PlaneContact([0, 0, 0], [0, 0, 1], 1.0, 0.0), "softness is 0.0"),
        (sk.SphereContact([0, 0, 0], -1.0, 1.0, 0.1), "radius is -1.0"),
        (sk.SphereContact([0, np.inf, 0], 1.0, 1.0, 0.1), "centre is not finite"),
    ],
)
def test_wrong_bodies_are_refused(term, words):
    with pytest.raises(ValueError, match=words):
        term.check(MESH)
