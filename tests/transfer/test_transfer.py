"""Fields carried between meshes: exactly to a refinement, and ever better to any other mesh as both get finer."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk


AXIS = jnp.array([0.0, 0.0, 1.0])


def apart(one, other):
    """Angle between directors, in radians."""
    return np.abs(np.arcsin(np.sin(np.asarray(one) - np.asarray(other))))


@pytest.mark.parametrize("mesh", [sk.meshes.icosphere(1), sk.meshes.rectangle(2.0, 1.0, cells=(3, 2))], ids=str)
def test_a_refinement_keeps_its_directors(mesh):
    angles = np.random.default_rng(0).uniform(-np.pi, np.pi, mesh.n_faces)
    fine = mesh.refine()
    found = sk.transfer_directors(mesh, angles, fine, smooth=False)
    assert apart(found, np.repeat(angles, 4)).max() < 1e-12
    assert np.abs(found).max() <= np.pi / 2
    values = np.random.default_rng(1).normal(size=(mesh.n_faces, 2))
    assert np.array_equal(sk.transfer_face_values(mesh, values, fine, smooth=False), np.repeat(values, 4, axis=0))


def test_a_head_is_as_good_as_a_tail():
    mesh, other = sk.meshes.icosphere(2), sk.meshes.sphere(0.25)
    angles = sk.director_angles(mesh, AXIS)
    turned = angles + np.pi * np.random.default_rng(0).integers(-2, 3, mesh.n_faces)
    assert apart(sk.transfer_directors(mesh, angles, other), sk.transfer_directors(mesh, turned, other)).max() < 1e-12


def uneven_sphere(size):
    """A unit sphere whose triangles are of unequal size."""
    mesh = sk.meshes.sphere(size)
    moved = mesh.vertices + 0.15 * size * np.random.default_rng(0).normal(size=mesh.vertices.shape)
    return mesh.with_vertices(moved / jnp.linalg.norm(moved, axis=1, keepdims=True))


def meridians(mesh):
    """The angles of the direction to the pole, of the sphere itself, at the centroids."""
    outward = np.asarray(mesh.vertices)[np.asarray(mesh.faces)].mean(axis=1)
    outward = outward / np.linalg.norm(outward, axis=1, keepdims=True)
    return sk.director_angles(mesh, AXIS - outward * outward[:, 2:]), np.abs(outward[:, 2]) < 0.8


def test_smooth_transfer_is_of_second_order():
    """To the meridians of a sphere, off the poles, where they are undefined; on meshes that share nothing."""
    target = sk.meshes.sphere(0.2)
    exact, off_pole = meridians(target)
    errors = []
    for size in (0.2, 0.1):
        mesh = uneven_sphere(size)
        errors.append(apart(sk.transfer_directors(mesh, meridians(mesh)[0], target), exact)[off_pole].max())
    assert np.log2(errors[0] / errors[1]) > 1.8 and errors[1] < np.deg2rad(0.5)


def test_linear_values_are_carried_exactly_in_the_plane():
    """Where the target's centroids lie in the source, up to its corners, which have but a face or two."""
    source = sk.meshes.rectangle(2.0, 1.0, cells=(5, 3))
    moved = np.asarray(source.vertices) + 0.02 * np.random.default_rng(0).normal(size=source.vertices.shape) * [1, 1, 0]
    inside = ~np.asarray(source.boundary_vertices)
    source = source.with_vertices(jnp.asarray(np.where(inside[:, None], moved, source.vertices)))
    target = sk.meshes.rectangle(1.0, 0.5, cells=(7, 5))
    target = target.with_vertices(target.vertices + source.vertices.mean(axis=0) - target.vertices.mean(axis=0))
    linear = lambda mesh: mesh.vertices[mesh.faces].mean(axis=1) @ jnp.array([1.0, -2.0, 0.0])
    found = sk.transfer_face_values(source, linear(source), target)
    np.testing.assert_allclose(found, linear(target), atol=1e-5)


def test_values_are_carried_linearly_and_constants_exactly():
    mesh, target = sk.meshes.icosphere(1), sk.meshes.sphere(0.4)
    assert np.allclose(sk.transfer_face_values(mesh, np.full(mesh.n_faces, 1.3), target), 1.3, atol=1e-14)
    slope = jax.grad(lambda v: jnp.sum(sk.transfer_face_values(mesh, v, target)))(jnp.ones(mesh.n_faces))
    assert np.isclose(slope.sum(), target.n_faces, rtol=1e-13)


def test_wrong_lengths_are_refused():
    mesh = sk.meshes.icosphere(0)
    with pytest.raises(ValueError, match=r"shape \(5,\), but the source mesh has 20 faces"):
        sk.transfer_face_values(mesh, np.ones(5), mesh)
    with pytest.raises(ValueError, match=r"angles has shape \(5,\)"):
        sk.transfer_directors(mesh, np.ones(5), mesh)
