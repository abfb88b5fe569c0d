"""Directors: angles from directions in space, and directions from angles."""

import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk


def test_angles_on_a_sheet_count_from_the_first_edge():
    sheet = sk.meshes.rectangle(2.0, 1.0, cells=(3, 2))
    first = np.asarray(sheet.vertices)[np.asarray(sheet.faces)]
    first = first[:, 1] - first[:, 0]
    from_x = np.arctan2(first[:, 1], first[:, 0])
    for degrees in (0, 30, 90, 200):
        angle = np.deg2rad(degrees)
        found = sk.director_angles(sheet, jnp.array([np.cos(angle), np.sin(angle), 5.0]))
        assert np.allclose(np.exp(1j * np.asarray(found)), np.exp(1j * (angle - from_x)), atol=1e-14)


def test_there_and_back(generic):
    angles = np.random.default_rng(1).uniform(-np.pi, np.pi, generic.n_faces)
    directors = sk.directors(generic, angles)
    assert np.allclose(np.linalg.norm(directors, axis=1), 1, atol=1e-14)
    assert np.allclose(np.sum(directors * sk.face_normals(generic.vertices, generic), 1), 0, atol=1e-14)
    assert np.allclose(sk.director_angles(generic, directors), angles, atol=1e-13)
    assert np.allclose(sk.directors(generic, angles + np.pi), -directors, atol=1e-14)


def test_projection_along_the_normal_and_length_do_not_count(generic):
    direction = np.array([0.2, -0.5, 1.0])
    lifted = 3 * direction + 7 * np.asarray(sk.face_normals(generic.vertices, generic))
    assert np.allclose(sk.director_angles(generic, lifted), sk.director_angles(generic, direction), atol=1e-12)
    assert np.allclose(sk.director_angles(generic, [0, 0, 1]), sk.director_angles(generic, [0.0, 0.0, 2.0]))


@pytest.mark.parametrize("shape", [(2,), (42, 3), (80, 2), ()])
def test_other_shapes_are_refused(shape, generic):
    with pytest.raises(ValueError, match=r"direction has shape .*\(80, 3\)"):
        sk.director_angles(generic, np.ones(shape))
    with pytest.raises(ValueError, match=r"angles has shape .*\(80,\)"):
        sk.directors(generic, np.ones(shape))
