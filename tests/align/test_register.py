"""Registration finds a surface wherever it lies, by its own points or by those of another mesh."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import shellkit as sk


BASE = sk.meshes.icosphere(2)
# No symmetry: three half-axes, and a bump.
SHAPE = lambda p: p * jnp.array([0.6, 1.0, 1.5]) + 0.2 * jnp.sin(2 * p[:, ::-1] + 0.5)
TARGET = BASE.with_vertices(SHAPE(BASE.vertices))
ELSEWHERE = [Rotation.random(random_state=k).as_matrix() for k in range(4)]


@pytest.mark.parametrize("turn", ELSEWHERE)
def test_a_mesh_comes_back_from_anywhere(turn):
    far = TARGET.with_vertices(TARGET.vertices @ turn + jnp.array([30.0, -5.0, 2.0]))
    motion = sk.register(far, TARGET)
    moved = motion(far)
    assert isinstance(moved, sk.Mesh)
    assert np.allclose(moved.vertices, TARGET.vertices, atol=1e-8)
    assert np.allclose(motion(far.vertices), moved.vertices, atol=1e-14)
    assert np.isclose(np.linalg.det(motion.rotation), 1.0)


def test_vertices_may_crowd_on_one_side():
    """Moments of a surface do not ask how it is cut into triangles; those of its vertices would."""
    points, faces = np.asarray(TARGET.vertices), np.asarray(TARGET.faces)
    for _ in range(2):
        chosen = points[faces][:, :, 2].mean(axis=1) > 0
        middles = points[faces[chosen]].mean(axis=1)
        new = len(points) + np.arange(len(middles))
        parts = [np.stack([faces[chosen, k], faces[chosen, (k + 1) % 3], new], axis=1) for k in range(3)]
        points, faces = np.concatenate([points, middles]), np.concatenate([faces[~chosen], *parts])
    assert (points[:, 2] > 0).mean() > 0.8
    uneven = sk.Mesh(points @ ELSEWHERE[0] - 4.0, faces)
    assert np.allclose(sk.register(uneven, TARGET)(uneven).vertices, points, atol=1e-8)


def test_points_without_faces():
    points = np.asarray(TARGET.vertices)
    motion = sk.register(points @ ELSEWHERE[1] + 3.0, points)
    assert np.allclose(motion(jnp.asarray(points @ ELSEWHERE[1] + 3.0)), points, atol=1e-8)


def test_what_cannot_be_registered_is_refused():
    with pytest.raises(ValueError, match=r"register: target has shape \(2, 3\)"):
        sk.register(TARGET, np.zeros((2, 3)))
    with pytest.raises(ValueError, match="register: mesh has a point that is not finite, number 1"):
        sk.register(np.array([[0, 0, 0], [np.nan, 0, 0], [1, 0, 0], [0, 1, 0.0]]), TARGET)
    with pytest.raises(ValueError, match="cannot be traced: use ICP"):
        jax.jit(lambda v: sk.register(v, TARGET).rotation)(TARGET.vertices)
