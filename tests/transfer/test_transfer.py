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


def test_smooth_transfer_converges():
    """To the meridians of a sphere, away from the poles, where they are undefined: of first order, as triangles of
    unequal size are averaged."""
    target = sk.meshes.sphere(0.2)
    off_pole = np.abs(np.asarray(target.vertices)[np.asarray(target.faces)].mean(axis=1)[:, 2]) < 0.8
    errors = []
    for subdivisions in (2, 3):
        mesh = sk.meshes.icosphere(subdivisions)
        found = sk.transfer_directors(mesh, sk.director_angles(mesh, AXIS), target)
        errors.append(apart(found, sk.director_angles(target, AXIS))[off_pole].mean())
    assert errors[1] < 0.6 * errors[0] and errors[1] < np.deg2rad(1)


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
