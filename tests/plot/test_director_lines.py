"""Directors carried along with a surface, against the motion that carries them."""

import jax.numpy as jnp
import numpy as np

import shellkit as sk
from shellkit._plot import director_lines as lines


def test_at_rest_they_are_the_directors(sphere):
    angles = np.linspace(-4, 4, sphere.n_faces)
    carried = lines.carried_directors(sphere, np.asarray(sphere.vertices), angles)
    np.testing.assert_allclose(carried, sk.directors(sphere, angles), atol=1e-14)


def test_an_affine_motion_maps_them_as_it_maps_vectors(sphere):
    linear = np.array([[1.2, 0.3, 0.0], [-0.1, 0.8, 0.2], [0.4, 0.0, 1.1]])
    angles = np.linspace(-4, 4, sphere.n_faces)
    carried = lines.carried_directors(sphere, np.asarray(sphere.vertices) @ linear + 5.0, angles)
    expected = np.asarray(sk.directors(sphere, angles)) @ linear
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(carried, expected, atol=1e-14)


def test_lines_lie_off_their_faces_within_them(sphere):
    angles = np.linspace(-4, 4, sphere.n_faces)
    points = np.asarray(sphere.vertices)
    normals = np.asarray(sk.face_normals(sphere.vertices, sphere))
    corners = points[np.asarray(sphere.faces)]
    heights = []
    for level in (1, 2):
        tails, heads, radius = lines.director_lines(sphere, points, angles, level)
        for ends in (tails, heads):
            off = np.sum((ends - corners[:, 0]) * normals, axis=1)
            np.testing.assert_allclose(off, 1.2 * level * radius, rtol=1e-12)
            for k in range(3):
                inward = np.cross(normals, corners[:, (k + 1) % 3] - corners[:, k])
                assert (np.sum((ends - corners[:, k]) * inward, axis=1) > 0).all()
        heights.append(off[0])
    assert heights[1] > heights[0]


def test_a_fine_mesh_shows_evenly_spread_lines():
    mesh = sk.meshes.icosphere(subdivisions=5)
    tails, heads, _ = lines.director_lines(mesh, np.asarray(mesh.vertices), np.zeros(mesh.n_faces), 1)
    assert mesh.n_faces > 20000 and 1000 < len(tails) < 4000
    middles = (tails + heads) / 2
    each_octant = np.unique(middles > 0, axis=0, return_counts=True)[1]
    assert len(each_octant) == 8 and each_octant.max() < 1.25 * each_octant.min()


def test_they_follow_a_flat_sheet_that_is_sheared():
    sheet = sk.meshes.rectangle(1.0, 1.0, cells=(2, 2))
    along_y = np.asarray(sk.director_angles(sheet, jnp.array([0.0, 1.0, 0.0])))
    sheared = np.asarray(sheet.vertices).copy()
    sheared[:, 0] += sheared[:, 1]
    carried = lines.carried_directors(sheet, sheared, along_y)
    np.testing.assert_allclose(np.abs(carried), np.full((sheet.n_faces, 3), [1, 1, 0]) / np.sqrt(2), atol=1e-14)
