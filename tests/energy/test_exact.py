"""Energies against exact values: affine strains, spheres and cylinders."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk


YOUNG, POISSON, THICKNESS = 1.7, 0.3, 0.02
PATCH = sk.meshes.rectangle(1.0, 1.0, cells=(4, 4), diagonals="jittered", seed=3)


def problem(energy, mesh=PATCH, thickness=THICKNESS, actuation=None):
    return sk.InverseProblem(mesh=mesh, thickness=thickness, energy=energy, actuation=actuation)


def stretched(strain, across):
    return PATCH.vertices * jnp.array([1 + strain, 1 + across, 1.0])


@pytest.mark.parametrize("material", [sk.StVenantKirchhoff, sk.NeoHookean])
def test_uniaxial_stress(material):
    """W = E h eps² / 2 an area, and no force across at eps₂ = -nu eps."""
    elastic = problem(material.from_young(YOUNG, POISSON))
    strain = 1e-4
    energy = lambda across: elastic.total_energy(stretched(strain, across))
    assert np.isclose(float(energy(-POISSON * strain)), 0.5 * YOUNG * THICKNESS * strain**2, rtol=1e-3)
    slope, stiffness = jax.grad(energy)(-POISSON * strain), jax.grad(jax.grad(energy))(-POISSON * strain)
    assert abs(float(slope / stiffness)) < 2e-4 * strain * 10


def test_affine_strain_is_exact():
    """Any affine map of a flat patch: h/4 (alpha tr(M)² + 2 beta tr(M²)) an area, M = FᵀF - 1, whatever the
    triangles."""
    alpha, beta = 0.7, 1.1
    map_ = np.array([[1.2, 0.3], [-0.1, 0.8]])
    strain = map_.T @ map_ - np.eye(2)
    expected = THICKNESS / 4 * (alpha * np.trace(strain) ** 2 + 2 * beta * np.trace(strain @ strain))
    vertices = jnp.column_stack([PATCH.vertices[:, :2] @ map_.T, jnp.zeros(PATCH.n_vertices)])
    assert np.isclose(float(problem(sk.StVenantKirchhoff(alpha, beta)).total_energy(vertices)), expected, rtol=1e-12)


def test_neo_hookean_matches_at_rest():
    """At rest both materials have one Hessian, for mu = 8 beta and K = 8 (alpha + beta)."""
    a, b = (
        problem(m.from_young(YOUNG, POISSON)).hessian(PATCH.vertices).values
        for m in (sk.StVenantKirchhoff, sk.NeoHookean)
    )
    assert jnp.allclose(a, b, rtol=0, atol=1e-12 * jnp.abs(a).max())


def test_scaled_sphere():
    """A sphere scaled by rho with forms lambda² g0 and c b0: b scales as the length, so both terms are exact on the
    mesh."""
    mesh = sk.meshes.icosphere(subdivisions=2)
    alpha, beta, h, stretch, rho = 0.6, 1.3, 0.2, 1.1, 1.25
    actuation = sk.IsotropicGrowth(stretch)
    energy = sk.StVenantKirchhoff(alpha, beta) + sk.Bending(alpha, beta)
    area = float(sk.surface_area(mesh.vertices, mesh))
    # On the mesh b0 differs from g0 slightly; bending is compared through its own rest energy scaling.
    membrane = problem(sk.StVenantKirchhoff(alpha, beta), mesh, h, actuation).total_energy(rho * mesh.vertices)
    expected = h / 4 * stretch**2 * area * (4 * alpha + 4 * beta) * (rho**2 / stretch**2 - 1) ** 2
    assert np.isclose(float(membrane), expected, rtol=1e-12)
    total = problem(energy, mesh, h, actuation).total_energy(rho * mesh.vertices)
    bending = float(total - membrane)
    exact = 4 * np.pi * (h**3 / 3) * stretch**2 * (alpha + beta) * ((rho - 1) / stretch**2) ** 2
    assert np.isclose(bending, exact, rtol=0.02)


def test_second_form_of_a_sphere_tends_to_its_metric():
    """b = +g on the unit sphere with outward normals. Averaged normals get there on the mean, at first order only."""
    errors = []
    for level in (2, 3, 4):
        mesh = sk.meshes.icosphere(subdivisions=level)
        g, b = sk.first_form(mesh.vertices, mesh), sk.second_form(mesh.vertices, mesh)
        errors.append(float(jnp.mean(jnp.linalg.norm(b - g, axis=(1, 2)) / jnp.linalg.norm(g, axis=(1, 2)))))
    assert errors[0] < 0.1 and errors[1] < 0.65 * errors[0] and errors[2] < 0.65 * errors[1]


def test_second_form_from_edge_normals():
    """The formula in heights and half angles against the definition b11 = 2 u·(n_a - n_b) and so on."""
    mesh = sk.meshes.icosphere(subdivisions=1)
    x = np.asarray(mesh.vertices) + 0.05 * np.random.default_rng(0).normal(size=mesh.vertices.shape)
    normals = np.asarray(sk.face_normals(jnp.asarray(x), mesh))
    neighbours = np.asarray(mesh.twins) // 3
    edge_normals = normals[:, None] + normals[neighbours]
    na, nb, nc = np.moveaxis(edge_normals / np.linalg.norm(edge_normals, axis=-1, keepdims=True), 1, 0)
    a, b, c = np.moveaxis(x[np.asarray(mesh.faces)], 1, 0)
    u, v = b - a, c - a
    dot = lambda p, q: (p * q).sum(-1)
    expected = np.stack(
        [
            np.stack([2 * dot(u, na - nb), dot(u, na - nc) + dot(v, na - nb)], -1),
            np.stack([dot(u, na - nc) + dot(v, na - nb), 2 * dot(v, na - nc)], -1),
        ],
        -2,
    )
    assert np.allclose(sk.second_form(jnp.asarray(x), mesh), expected, rtol=0, atol=1e-13)


def test_dihedral_bending_of_one_hinge():
    angle = 0.7
    flat = sk.Mesh(np.array([[0, 0, 0], [1, 0, 0], [0.5, 2, 0], [0.5, -1, 0.0]]), np.array([[0, 1, 2], [1, 0, 3]]))
    bent = jnp.array([[0, 0, 0], [1, 0, 0], [0.5, 2, 0], [0.5, -np.cos(angle), -np.sin(angle)]])
    expected = 0.3 * 1.0 / ((1.0 + 0.5) / 3) * angle**2
    assert np.isclose(float(problem(sk.DihedralBending(0.3), flat).total_energy(bent)), expected, rtol=1e-12)
    assert float(sk.dihedral_angles(bent, flat).max()) == pytest.approx(angle)


def test_a_sum_over_many_faces_loses_no_digits():
    """Of 80,000 of all sizes, in closed form. Added one after the other, they would lose nearly two digits."""
    sheet = sk.meshes.rectangle(1.0, 1.0, cells=(200, 200), diagonals="jittered", seed=0)
    elastic = problem(sk.StVenantKirchhoff(alpha=1.0, beta=0.5), sheet)
    found = float(elastic.total_energy(sheet.vertices * jnp.array([1.1, 1.0, 1.0])))
    assert np.isclose(found, THICKNESS / 4 * (1.0 + 2 * 0.5) * (1.1**2 - 1) ** 2, rtol=4e-15, atol=0)
