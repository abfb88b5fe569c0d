"""Dihedral angles and curvatures against polyhedra, the theorems of Gauss-Bonnet and Steiner, and smooth surfaces."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk


@jax.jit
def measured(vertices, mesh):
    """All quantities at once: compiling takes longer than computing."""
    quantities = (sk.edge_lengths, sk.vertex_areas, sk.voronoi_areas, sk.dihedral_angles)
    quantities += (sk.mean_curvature, sk.angle_defects, sk.gauss_curvature)
    return {quantity.__name__: quantity(vertices, mesh) for quantity in quantities}


jacobian = jax.jit(jax.jacrev(sk.dihedral_angles))


def test_cube_has_right_angles(cube):
    found = measured(cube.vertices, cube)
    assert np.allclose(
        found["dihedral_angles"], np.where(np.asarray(found["edge_lengths"]) > 1.2, 0, np.pi / 2), atol=1e-15
    )
    assert np.allclose(found["angle_defects"], np.pi / 2, atol=1e-14)
    assert np.isclose(np.sum(found["mean_curvature"] * found["voronoi_areas"]), 3 * np.pi, atol=1e-13)


def test_icosahedron():
    mesh = sk.meshes.icosphere(subdivisions=0)
    found = measured(mesh.vertices, mesh)
    edge = 1 / np.sin(2 * np.pi / 5)
    area = 5 * np.sqrt(3) / 12 * edge**2
    assert np.allclose(found["dihedral_angles"], np.arccos(np.sqrt(5) / 3), atol=1e-14)
    assert np.allclose(found["angle_defects"], np.pi / 3, atol=1e-14)
    assert np.allclose(found["voronoi_areas"], area, atol=1e-14)
    assert np.allclose(found["vertex_areas"], area, atol=1e-14)
    assert np.allclose(found["gauss_curvature"], np.pi / 3 / area, rtol=1e-13)


@pytest.mark.parametrize("degrees", [-180 + 1e-9, -179.9, -90, -1e-6, 0, 1e-6, 30, 90, 179.9, 180 - 1e-9])
def test_roof_at_any_angle(degrees, roof):
    mesh, fold = roof
    angle = np.deg2rad(degrees)
    hinge = ~np.asarray(mesh.boundary_edges)
    vertices = jnp.asarray(fold(angle))
    found = np.asarray(sk.dihedral_angles(vertices, mesh))
    assert np.allclose(found[hinge], angle, atol=1e-14) and (found[~hinge] == 0).all()
    slope = jacobian(vertices, mesh)[hinge.argmax()]
    # Lifting a corner at unit height turns its face by one radian for each unit of length.
    assert np.allclose(slope[2], [0, 0, -1], atol=1e-12)
    assert np.allclose(slope.sum(0), 0, atol=1e-12)


def test_folded_flat_is_finite(roof):
    mesh, fold = roof
    flat = jnp.asarray(fold(0.0)).at[3].set([0.5, 1.0, 0.0])
    angles, slopes = sk.dihedral_angles(flat, mesh), jacobian(flat, mesh)
    assert np.isclose(np.abs(angles).max(), np.pi) and np.isfinite(slopes).all()


def test_voronoi_cells_hold_the_nearest_points(roof):
    """In an acute face, a cell is the kite of the corner, the middles of its sides and the circumcentre."""
    mesh, fold = roof
    vertices = fold(0.3)
    kites = np.zeros(4)
    for face in np.asarray(mesh.faces):
        for i in range(3):
            p, q, r = vertices[np.roll(face, -i)]
            u, v = q - p, r - p
            normal = np.cross(u, v)
            centre = p + np.linalg.solve([[u @ u, u @ v], [u @ v, v @ v]], [u @ u / 2, v @ v / 2]) @ [u, v]
            assert np.allclose([np.linalg.norm(centre - x) for x in (q, r)], np.linalg.norm(centre - p))
            kite = 0.5 * np.cross(centre - p, (r - q) / 2)
            kites[face[i]] += abs(kite @ normal) / np.linalg.norm(normal)
    assert np.allclose(sk.voronoi_areas(jnp.asarray(vertices), mesh), kites, atol=1e-14)


def test_obtuse_faces_are_halved_and_quartered():
    mesh = sk.Mesh([[0.0, 0, 0], [4, 0, 0], [1, 0.5, 0]], [[0, 1, 2]])
    assert np.allclose(sk.voronoi_areas(mesh.vertices, mesh), [0.25, 0.25, 0.5], atol=1e-15)
    assert np.allclose(sk.angle_defects(mesh.vertices, mesh).sum(), 2 * np.pi, atol=1e-14)


@pytest.mark.parametrize(
    ("mesh", "euler"),
    [
        (sk.meshes.icosphere(subdivisions=2), 2),
        (sk.meshes.torus(1.0, 0.4, cells=(12, 8)), 0),
        (sk.meshes.rectangle(2.0, 1.0, cells=(4, 3)), 1),
        (sk.meshes.cylinder(1.0, 1.0, cells=(8, 3)), 0),
    ],
    ids=["sphere", "torus", "sheet", "tube"],
)
def test_gauss_bonnet(mesh, euler):
    shaken = mesh.vertices + 0.02 * np.random.default_rng(0).normal(size=mesh.vertices.shape)
    found = measured(shaken, mesh)
    assert np.isclose(found["angle_defects"].sum(), 2 * np.pi * euler, atol=1e-11)
    assert np.isclose(found["voronoi_areas"].sum(), sk.surface_area(shaken, mesh), rtol=1e-13)


def test_flat_sheet_has_no_curvature():
    mesh = sk.meshes.rectangle(2.0, 1.0, cells=(4, 3))
    shaken = mesh.vertices + np.random.default_rng(0).uniform(-0.05, 0.05, (20, 3)) * [1, 1, 0]
    found = measured(shaken, mesh)
    for quantity in ("dihedral_angles", "mean_curvature", "gauss_curvature"):
        assert np.allclose(found[quantity], 0, atol=1e-12)


def test_sphere():
    mesh = sk.meshes.icosphere(subdivisions=3, radius=2.0)
    found = measured(mesh.vertices, mesh)
    assert np.allclose(found["mean_curvature"], 1 / 2, rtol=0.08)
    assert np.allclose(found["gauss_curvature"], 1 / 4, rtol=0.08)
    assert np.isclose(np.average(found["mean_curvature"], weights=found["voronoi_areas"]), 1 / 2, rtol=5e-3)


def test_cylinder():
    mesh = sk.meshes.cylinder(2.0, 3.0, cells=(48, 12))
    found = measured(mesh.vertices, mesh)
    inside = ~np.asarray(mesh.boundary_vertices)
    assert np.allclose(found["mean_curvature"][inside], 1 / 4, rtol=1e-2)
    assert np.allclose(found["gauss_curvature"], 0, atol=1e-12)


def test_torus():
    """The mean curvature integrates to 2 pi^2 times the major radius; the Gauss curvature changes sign."""
    mesh = sk.meshes.torus(1.0, 0.4, cells=(60, 36))
    found = measured(mesh.vertices, mesh)
    assert np.isclose(np.sum(found["voronoi_areas"] * found["mean_curvature"]), 2 * np.pi**2, rtol=5e-3)
    distance = np.linalg.norm(np.asarray(mesh.vertices)[:, :2], axis=1)
    gauss = (distance - 1.0) / 0.4**2 / distance
    assert np.allclose(found["gauss_curvature"], gauss, atol=0.03 * np.abs(gauss).max())


def test_curvature_scales_with_the_inverse_length_and_turns_with_the_normals(generic):
    here, larger = measured(generic.vertices, generic), measured(10 * generic.vertices, generic)
    turned = measured(generic.vertices, generic.flipped())
    assert np.allclose(10 * larger["mean_curvature"], here["mean_curvature"], rtol=1e-11)
    assert np.allclose(100 * larger["gauss_curvature"], here["gauss_curvature"], rtol=1e-11)
    assert np.allclose(turned["mean_curvature"], -here["mean_curvature"], atol=1e-13)
    assert np.allclose(turned["gauss_curvature"], here["gauss_curvature"], atol=1e-12)
