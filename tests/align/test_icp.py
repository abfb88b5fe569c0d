"""Alignment without correspondences: it finds the pose, its derivative is that of the minimum."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk


def rotation(angles):
    spin = np.cross(np.eye(3), angles)
    return np.linalg.solve(np.eye(3) - spin / 2, np.eye(3) + spin / 2)


BASE = sk.meshes.icosphere(2)
TARGET = BASE.with_vertices(BASE.vertices * jnp.array([0.6, 1.0, 1.5]) + 0.1 * jnp.sin(3 * BASE.vertices[:, ::-1]))


@pytest.mark.parametrize("with_faces", [True, False])
def test_a_moved_part_of_the_target_comes_back(with_faces):
    points = (TARGET.refine() if with_faces else TARGET).vertices[40:]
    icp = sk.ICP(TARGET.faces if with_faces else None)
    # Nearest points of a set, unlike those of a surface, are the wrong ones from a spacing away.
    far = 1.0 if with_faces else 0.2
    moved = points @ rotation(far * np.array([0.2, -0.3, 0.3])) + far * jnp.array([0.2, -0.1, 0.15])
    assert np.allclose(icp(moved, TARGET.vertices), points, atol=1e-10)
    motion = icp.motion(moved, TARGET.vertices)
    assert np.allclose(motion.rotation @ motion.rotation.T, np.eye(3), atol=1e-14)


def test_a_start_brings_back_what_is_far_away():
    marks = np.array([0, 5, 30, 60])
    far = TARGET.vertices @ rotation([0, 6.0, 2.0]) + 10
    icp = sk.ICP(TARGET.faces, start=sk.Landmarks(marks))
    assert icp.removes_motion and not sk.ICP(TARGET.faces).removes_motion
    assert np.allclose(icp(far, TARGET.vertices), TARGET.vertices, atol=1e-10)


def test_derivative_is_that_of_the_minimum():
    """Against differences, in the points and in the target, where no pose fits exactly."""
    random = np.random.default_rng(2)
    points = 1.1 * sk.meshes.sphere(0.6).vertices * jnp.array([0.6, 1.0, 1.5])
    x = (points, TARGET.vertices)
    direction = jax.tree.map(lambda leaf: jnp.asarray(random.normal(size=leaf.shape)), x)
    weights = jnp.asarray(random.normal(size=points.shape))

    def moved(x):
        return jnp.sum(weights * sk.ICP(TARGET.faces)(*x))

    both = jax.jit(lambda x: (moved(x), jax.grad(moved)(x), jax.jvp(moved, (x,), (direction,))[1]))
    step = 1e-6
    here, up, down = (both(jax.tree.map(lambda a, d, s=s: a + s * step * d, x, direction)) for s in (0, 1, -1))
    backwards = sum(jnp.vdot(g, d) for g, d in zip(here[1], direction, strict=True))
    assert np.isclose(backwards, here[2], rtol=1e-10)
    assert np.isclose(backwards, (up[0] - down[0]) / (2 * step), rtol=1e-6)


def test_a_sphere_turns_in_itself_with_finite_derivatives():
    mesh = sk.meshes.icosphere(1)
    slope = jax.jit(jax.grad(lambda v: jnp.sum(sk.ICP(mesh.faces)(v, mesh.vertices)[:, 0])))(1.1 * mesh.vertices)
    assert np.isfinite(slope).all()


def test_wrong_faces_are_refused():
    with pytest.raises(ValueError, match=r"faces has shape \(3,\)"):
        sk.ICP([0, 1, 2])
    with pytest.raises(ValueError, match="corner 161, but the target has 42 points"):
        sk.ICP(TARGET.faces)(TARGET.vertices, TARGET.vertices[:42])
