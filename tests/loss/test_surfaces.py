"""Losses between surfaces of different connectivity, at shapes where their value is known, and their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk


PASSIVE = sk.Passive()
STILL = sk.NoAlignment()


def rotation(angles):
    spin = np.cross(np.eye(3), angles)
    return np.linalg.solve(np.eye(3) - spin / 2, np.eye(3) + spin / 2)


def raised(mesh, height):
    return mesh.with_vertices(mesh.vertices + jnp.array([0.0, 0.0, height]))


def bumpy(mesh, seed=0, size=0.03):
    shaken = mesh.vertices + size * np.random.default_rng(seed).normal(size=mesh.vertices.shape)
    return mesh.with_vertices(shaken * jnp.array([0.9, 1.0, 1.2]))


def value(loss, mesh, at):
    return float(loss(at(mesh, mesh.vertices), PASSIVE))


def test_parallel_planes_are_their_distance_apart(at):
    here, there = sk.meshes.rectangle(2.0, 1.0, cells=(4, 2)), raised(sk.meshes.rectangle(2.0, 1.0, cells=(3, 3)), 0.3)
    assert np.isclose(value(sk.PointToSurface(there, aligner=STILL), here, at), 0.09, rtol=1e-13)
    upside_down = sk.PointToSurface(there.flipped(), normals=0.5, aligner=STILL)
    assert np.isclose(value(upside_down, here, at), 0.09 + 0.25 * 4, rtol=1e-13)
    assert np.isclose(value(sk.PointToSurface(there, normals=0.5, aligner=STILL), here, at), 0.09, rtol=1e-13)
    # The loss of a part of the target vanishes one way only.
    part = sk.meshes.rectangle(1.0, 1.0, cells=(2, 2))
    whole = sk.meshes.rectangle(2.0, 1.0, cells=(3, 3))
    assert value(sk.PointToSurface(whole, both_ways=False, aligner=STILL), part, at) < 1e-30
    gap = np.maximum(np.asarray(whole.vertices)[:, 0] - 1, 0)
    expected = np.average(gap**2, weights=np.asarray(sk.vertex_areas(whole.vertices, whole))) / 2
    assert np.isclose(value(sk.PointToSurface(whole, aligner=STILL), part, at), expected, rtol=1e-13)


def test_concentric_spheres_are_their_radii_apart(at):
    """The corner of a convex polyhedron is the nearest point of it to all that lies straight above."""
    outer, inner = sk.meshes.icosphere(1, radius=1.2), sk.meshes.icosphere(1)
    assert np.isclose(value(sk.PointToSurface(inner, both_ways=False, aligner=STILL), outer, at), 0.04, rtol=1e-12)
    assert np.isclose(value(sk.Chamfer(inner.vertices, aligner=STILL), outer, at), 0.08, rtol=1e-12)


def test_the_same_surface_in_other_triangles_costs_nothing(at, sphere):
    """Zero, with a gradient of zero: also where the points do not correspond."""
    mesh = bumpy(sphere)
    finer = mesh.refine()
    losses = [
        sk.PointToSurface(finer, normals=None, aligner=STILL),
        sk.Chamfer(mesh.vertices[::-1], aligner=STILL),
        sk.Varifold(mesh, aligner=STILL),
        sk.Varifold(mesh.flipped(), oriented=False, aligner=STILL),
    ]

    def values(v):
        return jnp.stack([loss(at(mesh, v), PASSIVE) for loss in losses])

    found, slopes = jax.jit(lambda v: (values(v), jax.jacrev(values)(v)))(mesh.vertices)
    assert np.abs(found).max() < 1e-13
    assert np.abs(slopes).max() < 1e-13
    assert float(sk.Varifold(mesh.flipped(), aligner=STILL)(at(mesh, mesh.vertices), PASSIVE)) > 0.1


def test_chamfer_against_all_pairs(at, sphere):
    points = np.random.default_rng(3).normal(size=(60, 3))
    squared = ((np.asarray(sphere.vertices)[:, None] - points) ** 2).sum(axis=2)
    expected = squared.min(axis=1).mean() + squared.min(axis=0).mean()
    assert np.isclose(value(sk.Chamfer(points, aligner=STILL), sphere, at), expected, rtol=1e-13)


def patches(mesh):
    a, b, c = np.moveaxis(np.asarray(mesh.vertices)[np.asarray(mesh.faces)], 1, 0)
    doubled = np.cross(b - a, c - a)
    size = np.linalg.norm(doubled, axis=1)
    return (a + b + c) / 3, doubled / size[:, None], size / 2


@pytest.mark.parametrize("oriented", [True, False])
def test_varifold_against_all_pairs(oriented, at):
    here, there = sk.meshes.icosphere(2), bumpy(sk.meshes.sphere(0.17))
    assert here.n_faces % 128 and there.n_faces > 512, "blocks should not fit by chance"

    def product(one, other, width):
        (c, n, a), (d, m, b) = patches(one), patches(other)
        near = np.exp(-((c[:, None] - d) ** 2).sum(axis=2) / width**2)
        cosine = n @ m.T
        return a @ (near * (((1 + cosine) / 2) ** 2 if oriented else cosine**2)) @ b

    def relative(width):
        own = product(there, there, width)
        return (product(here, here, width) - 2 * product(here, there, width) + own) / own

    expected = np.mean([relative(width) for width in (0.8, 0.4, 0.2)])
    loss = sk.Varifold(there, width=0.8, oriented=oriented, aligner=STILL)
    assert np.isclose(value(loss, here, at), expected, rtol=1e-11)


def test_varifold_sees_less_of_the_triangles_the_finer_they_are(at):
    def difference(cells):
        def wavy(diagonals):
            flat = sk.meshes.rectangle(1.0, 1.0, cells=(cells, cells), diagonals=diagonals)
            x, y, _ = flat.vertices.T
            return flat.with_vertices(flat.vertices.at[:, 2].set(0.1 * jnp.sin(3 * x + y)))

        return value(sk.Varifold(wavy("alternating"), width=0.4, scales=1, aligner=STILL), wavy("right"), at)

    coarse, fine = difference(6), difference(12)
    # The measures differ in the second order of the size of triangles, and the loss is a square.
    assert fine < coarse / 8 and coarse < 1e-2


SMOOTH = {
    "PointToSurface": lambda target: sk.PointToSurface(target),
    "Chamfer": lambda target: sk.Chamfer(target.vertices),
    "Varifold": lambda target: sk.Varifold(target),
}


@pytest.mark.parametrize("name", SMOOTH)
def test_taylor_with_alignment(name, at):
    """At a generic point, through the pose that ICP finds: forwards and backwards."""
    mesh, target = sk.meshes.icosphere(1), bumpy(sk.meshes.sphere(0.5))
    loss, random = SMOOTH[name](target), np.random.default_rng(1)
    x = (bumpy(mesh, 5).vertices) @ rotation([0.1, 0.2, -0.1]) + jnp.array([0.1, 0.0, -0.1])
    direction = jnp.asarray(random.normal(size=x.shape))

    def loss_at(v):
        return loss(at(mesh, v), PASSIVE)

    @jax.jit
    def both(v):
        found, slope = jax.value_and_grad(loss_at)(v)
        return found, jnp.vdot(slope, direction), jax.jvp(loss_at, (v,), (direction,))[1]

    step = 2e-6
    (_, backwards, forwards), up, down = (both(x + h * direction) for h in (0, step, -step))
    assert np.isclose(backwards, forwards, rtol=1e-10)
    assert np.isclose(backwards, (up[0] - down[0]) / (2 * step), rtol=1e-7)


def test_alignment_removes_a_small_motion(at):
    stretched = jnp.array([0.7, 1.0, 1.4])  # of one best pose
    mesh, target = (m.with_vertices(m.vertices * stretched) for m in (sk.meshes.icosphere(1), sk.meshes.sphere(0.5)))
    moved = mesh.vertices @ rotation([0.1, 0.2, -0.1]) + jnp.array([0.1, 0.0, -0.1])
    loss = sk.PointToSurface(target)
    assert np.isclose(loss(at(mesh, moved), PASSIVE), loss(at(mesh, mesh.vertices), PASSIVE), rtol=1e-9)


BAD = {
    "two lengths": (lambda: sk.PointToSurface(MESH, normals=np.ones(2)), r"normals has shape \(2,\)"),
    "negative length": (lambda: sk.PointToSurface(MESH, normals=-1.0), "normals is -1.0"),
    "flat points": (lambda: sk.Chamfer(np.zeros((4, 2))), r"target has shape \(4, 2\)"),
    "no width": (lambda: sk.Varifold(MESH, width=0.0), "width is 0.0"),
    "widths": (lambda: sk.Varifold(MESH, width=np.ones(2)), r"width has shape \(2,\)"),
    "no scales": (lambda: sk.Varifold(MESH, scales=0), "scales is 0"),
    "aligner": (
        lambda: sk.PointToSurface(MESH, aligner=sk.Kabsch()).check(sk.meshes.icosphere(1), PASSIVE),
        "Kabsch: 42",
    ),
    "faces of another": (
        lambda: sk.Chamfer(MESH.vertices[:5], sk.ICP(MESH.faces)).check(MESH, PASSIVE),
        "corner 11, but the target has 5",
    ),
}
MESH = sk.meshes.icosphere(0)


@pytest.mark.parametrize("case", BAD)
def test_what_does_not_fit_is_refused(case):
    build, words = BAD[case]
    with pytest.raises(ValueError, match=words):
        build()
