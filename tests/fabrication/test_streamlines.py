"""Streamlines follow the directors and keep their distance, on flat sheets and on curved ones."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import KDTree

import shellkit as sk


def centres(mesh):
    return np.asarray(mesh.vertices)[np.asarray(mesh.faces)].mean(axis=1)


def tangents(line):
    steps = np.diff(line, axis=0)
    return steps / np.linalg.norm(steps, axis=1, keepdims=True)


def distances_between(lines):
    """From each point of each line to the nearest point of another."""
    found = []
    for k, line in enumerate(lines):
        others = [other for j, other in enumerate(lines) if j != k]
        found.append(KDTree(np.concatenate(others)).query(line)[0])
    return found


@pytest.fixture(scope="module")
def bent_field():
    """A sheet whose directors turn along x, with the exact angle at any place."""
    mesh = sk.meshes.rectangle(8.0, 4.0, cells=(40, 20), diagonals="jittered")
    angle = lambda points: 0.2 * points[:, 0] + 0.3 * np.sin(points[:, 1])
    at = angle(centres(mesh))
    return mesh, sk.director_angles(mesh, np.stack([np.cos(at), np.sin(at), 0 * at], axis=1)), angle


@pytest.fixture(scope="module")
def bent_lines(bent_field):
    mesh, angles, _ = bent_field
    return sk.streamlines(mesh, angles, spacing=0.25)


def test_they_are_tangent_to_the_directors(bent_field, bent_lines):
    _, _, angle = bent_field
    off = []
    for line in bent_lines:
        along, middle = tangents(line), 0.5 * (line[1:] + line[:-1])
        exact = angle(middle)
        off.append(np.abs(np.cos(exact) * along[:, 1] - np.sin(exact) * along[:, 0]))
    off = np.concatenate(off)
    # Averaging is one-sided on the boundary, and even inside: the directors turn by 0.36 a unit, edges are 0.2 long.
    assert off.max() < 0.2 * 0.36 and np.median(off) < 0.1 * 0.2 * 0.36


def test_they_are_spaced_within_bounds(bent_field, bent_lines):
    mesh, _, _ = bent_field
    apart = distances_between(bent_lines)
    assert min(each.min() for each in apart) > 0.499 * 0.25
    assert 0.6 * 0.25 < np.median(np.concatenate(apart)) < 1.1 * 0.25
    # No hole is larger than a line would fit into: every face has a line within the spacing.
    to_line = KDTree(np.concatenate(bent_lines)).query(centres(mesh))[0]
    assert to_line.max() < 0.25


def test_they_stay_on_the_sheet_and_end_for_a_reason(bent_lines):
    for line in bent_lines:
        assert (line[:, 2] == 0).all()
        assert (line[:, :2] >= -1e-12).all() and (line[:, :2] <= np.array([8.0, 4.0]) + 1e-12).all()
    apart = distances_between(bent_lines)
    for line, near in zip(bent_lines, apart, strict=True):
        for end in (0, -1):
            on_boundary = np.isclose(line[end, :2], 0).any() or np.isclose(line[end, :2], [8.0, 4.0]).any()
            # A line that ends within the sheet would come too near with its next step, a sixth of the spacing.
            assert on_boundary or near[end] < (0.5 + 1 / 6 + 0.02) * 0.25


def test_parallel_lines_are_as_far_apart_as_asked(tmp_path):
    mesh = sk.meshes.rectangle(3.0, 1.0, cells=(6, 2))
    lines = sk.streamlines(mesh, np.zeros(mesh.n_faces), spacing=0.1)
    heights = np.sort([line[0, 1] for line in lines])
    np.testing.assert_allclose(np.diff(heights), 0.1, rtol=1e-9)
    assert len(lines) == 10
    for line in lines:
        np.testing.assert_allclose(line[:, 1], line[0, 1], atol=1e-12)
        np.testing.assert_allclose(sorted(line[[0, -1], 0]), [0, 3], atol=1e-12)


def test_circles_close(tmp_path):
    mesh = sk.meshes.annulus(1.0, 3.0, target_edge_length=0.25)
    at = centres(mesh)
    lines = sk.streamlines(mesh, sk.director_angles(mesh, np.stack([-at[:, 1], at[:, 0], 0 * at[:, 0]], 1)), 0.4)
    closed = [line for line in lines if (line[0] == line[-1]).all()]
    # The outermost and innermost run along a boundary of straight edges and may leave through it.
    assert len(closed) >= 4
    for line in closed:
        radii = np.linalg.norm(line, axis=1)
        assert np.ptp(radii) < 0.02
        length = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
        assert length == pytest.approx(2 * np.pi * radii.mean(), rel=0.01)


@pytest.fixture(scope="module")
def sphere_lines():
    mesh = sk.meshes.icosphere(subdivisions=2)
    return mesh, sk.streamlines(mesh, sk.director_angles(mesh, jnp.array([0.0, 0.0, 1.0])), spacing=0.2)


def test_meridians_of_a_sphere(sphere_lines):
    _, lines = sphere_lines
    assert len(lines) > 10
    for line in lines:
        radii = np.linalg.norm(line, axis=1)
        assert (radii > 0.94).all() and (radii < 1 + 1e-12).all()  # on the faces, which cut into the sphere
        away = line[np.abs(line[:, 2]) < 0.7]
        if len(away) > 1:
            longitude = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
            # Of the meridian it began on, but for the faces' own turning.
            assert np.ptp(longitude) < 0.1
    assert min(each.min() for each in distances_between(lines)) > 0.49 * 0.2


def test_the_head_of_a_director_does_not_matter():
    mesh = sk.meshes.rectangle(2.0, 1.0, cells=(8, 4))
    random = np.random.default_rng(0).integers(0, 2, mesh.n_faces) * np.pi
    straight = sk.streamlines(mesh, np.full(mesh.n_faces, 0.3), 0.2)
    turned = sk.streamlines(mesh, 0.3 + random, 0.2)
    assert len(straight) == len(turned)
    for one, other in zip(straight, turned, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)


def test_closest_makes_them_more_even(bent_field, bent_lines):
    mesh, angles, _ = bent_field
    even = sk.streamlines(mesh, angles, spacing=0.25, closest=0.9)
    assert min(each.min() for each in distances_between(even)) > 0.899 * 0.25
    mean_length = lambda lines: np.mean([np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines])
    assert mean_length(even) < mean_length(bent_lines)


def test_what_is_wrong_is_said():
    mesh = sk.meshes.rectangle(1.0, 1.0, cells=(1, 1))
    with pytest.raises(ValueError, match=r"layer of shape \(3,\).*\(2,\)"):
        sk.streamlines(mesh, np.zeros(3), 0.1)
    with pytest.raises(ValueError, match=r"spacing is -0\.1"):
        sk.streamlines(mesh, np.zeros(2), -0.1)
    with pytest.raises(ValueError, match="closest is 0"):
        sk.streamlines(mesh, np.zeros(2), 0.1, closest=0.0)
