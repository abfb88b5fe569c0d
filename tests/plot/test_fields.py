"""The fields that surfaces can be coloured by, against motions for which they are known."""

import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk
from shellkit._plot.fields import field_of
from shellkit._plot.shapes import shapes_of


def values(thing, name, target=None, aligner=None, problem=None):
    (shape,) = shapes_of(thing, True, target, aligner, problem)
    return field_of(shape, name).values


def test_displacement_is_the_distance_moved(sphere, equilibrium_of):
    shift = jnp.array([0.0, 3.0, 4.0])
    np.testing.assert_allclose(values(equilibrium_of(sphere, sphere.vertices + shift), "displacement"), 5.0, rtol=1e-14)


def test_stretches_of_a_sheet_pulled_one_way(equilibrium_of):
    sheet = sk.meshes.rectangle(2.0, 1.0, cells=(4, 3))
    pulled = equilibrium_of(sheet, sheet.vertices * jnp.array([1.3, 0.8, 1.0]), sk.IsotropicGrowth(stretch=1.1))
    np.testing.assert_allclose(values(pulled, "stretch"), 1.3, rtol=1e-12)
    np.testing.assert_allclose(values(pulled, "actuation"), 1.1, rtol=1e-12)
    np.testing.assert_allclose(values(pulled, "strain"), 1 - 0.8 / 1.1, rtol=1e-12)
    np.testing.assert_allclose(values(pulled, "thickness"), 0.1)


def test_actuation_of_a_nematic_sheet_is_its_stretch(sphere, equilibrium_of):
    nematic = sk.Nematic(angle=jnp.linspace(0, 3, sphere.n_faces), stretch=0.8)
    found = values(equilibrium_of(sphere, sphere.vertices, nematic), "actuation")
    np.testing.assert_allclose(found, 1 / 0.8, rtol=1e-12)


def test_curvatures_are_those_of_the_surface_as_it_is_drawn(sphere, equilibrium_of):
    doubled = equilibrium_of(sphere, 2 * sphere.vertices)
    for name, function in (("mean curvature", sk.mean_curvature), ("gauss curvature", sk.gauss_curvature)):
        np.testing.assert_allclose(values(doubled, name), function(2 * sphere.vertices, sphere), rtol=1e-12)


def test_error_of_an_equilibrium_is_measured_after_alignment(sphere, moved):
    stretched = sphere.vertices * jnp.array([0.9, 0.9, 1.3])
    np.testing.assert_allclose(values(moved, "error", stretched), 0.0, atol=1e-12)
    unaligned = np.linalg.norm(moved.vertices - stretched, axis=1)
    np.testing.assert_allclose(values(moved, "error", stretched, sk.NoAlignment()), unaligned, rtol=1e-12)


def test_error_against_another_mesh_is_the_distance_from_its_surface():
    sheet = sk.meshes.rectangle(1.0, 1.0, cells=(3, 3))
    wide = sk.meshes.rectangle(2.0, 2.0, cells=(5, 4))
    lifted = sheet.with_vertices(sheet.vertices + jnp.array([0.4, 0.4, 0.25]))
    np.testing.assert_allclose(values(lifted, "error", wide), 0.25, rtol=1e-6)


def test_data_of_the_mesh_are_fields():
    flat = sk.meshes.rectangle(1.0, 1.0, cells=(2, 2))
    mesh = sk.Mesh(flat.vertices, flat.faces, {"heat": jnp.arange(flat.n_vertices)}, {"group": np.arange(flat.n_faces)})
    np.testing.assert_array_equal(values(mesh, "heat"), np.arange(flat.n_vertices))
    np.testing.assert_array_equal(values(mesh, "group"), np.arange(flat.n_faces))


def test_stress_and_energy_of_a_sheet_pulled_all_ways(equilibrium_of):
    sheet = sk.meshes.rectangle(2.0, 1.0, cells=(4, 3))
    pulled = equilibrium_of(sheet, sheet.vertices * jnp.array([1.001, 1.001, 1.0]))
    problem = sk.InverseProblem(sheet, 0.1, sk.StVenantKirchhoff.from_young(2.0, 0.25))
    # Plane stress, to first order in the strain: sigma = E eps / (1 - nu), and w = h sigma eps.
    np.testing.assert_allclose(values(pulled, "stress", problem=problem), 2.0 * 0.001 / 0.75, rtol=3e-3)
    density = values(pulled, "energy density", problem=problem)
    np.testing.assert_allclose(density, 0.1 * 2.0 * 0.001**2 / 0.75, rtol=3e-3)


def test_a_problem_at_rest_shows_its_actuation(problem):
    (shape,) = shapes_of(problem, True, None, None, None)
    np.testing.assert_allclose(field_of(shape, "thickness").values, 0.1)
    metric = sk.first_form(problem.mesh.vertices, problem.mesh)
    expected = np.sqrt(np.linalg.eigvals(np.linalg.solve(metric, problem.rest_shape().metric)).max(axis=1))
    np.testing.assert_allclose(field_of(shape, "actuation").values, expected, rtol=1e-12)
    assert field_of(shape, "stress") is None and field_of(shape, "strain") is None


@pytest.mark.parametrize(
    ("name", "unit", "heading"),
    [
        ("displacement", "mm", "displacement (mm)"),
        ("displacement", None, "displacement (mesh unit)"),
        ("mean curvature", "mm", "mean curvature (1/mm)"),
        ("gauss curvature", "mm", "gauss curvature (1/mm²)"),
        ("strain", "mm", "strain"),
    ],
)
def test_headings_have_the_unit(moved, name, unit, heading):
    (shape,) = shapes_of(moved, True, None, None, None)
    assert field_of(shape, name).heading(unit, None) == heading
