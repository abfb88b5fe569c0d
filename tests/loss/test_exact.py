"""Losses at shapes where their value is known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk
from shellkit._loss.strain import principal_stretches


PASSIVE = sk.Passive()


def random_like(vertices, seed):
    return np.random.default_rng(seed).normal(size=vertices.shape)


def turned(points):
    turn = np.linalg.qr(np.random.default_rng(8).normal(size=(3, 3)))[0]
    return points @ (turn * np.linalg.det(turn)) + np.array([1.0, 2.0, -3.0])


def test_goals_that_are_reached_cost_nothing(sphere, at, bilayer):
    here = at(sphere, turned(2 * np.asarray(sphere.vertices)))
    v = here.vertices
    met = [
        sk.VertexDistance(2 * sphere.vertices),
        sk.VertexDistance(sphere.vertices, sk.Similarity()),
        sk.LandmarkDistance([1, 5, 20, 7], 2 * sphere.vertices[np.array([1, 5, 20, 7])]),
        sk.Sphericity(),
        sk.Area(sk.surface_area(v, sphere)),
        sk.Volume(sk.enclosed_volume(v, sphere)),
        sk.MeanCurvature(sk.mean_curvature(v, sphere)),
        sk.GaussCurvature(sk.gauss_curvature(v, sphere)),
        sk.StrainLimit(lower=1.9, upper=2.1),
    ]

    def values(v):
        return jnp.stack([loss(at(sphere, v), PASSIVE) for loss in met])

    found, slope = jax.jit(lambda v: (values(v), jax.grad(lambda v: jnp.sum(values(v)))(v)))(v)
    assert not [loss.name for loss, value in zip(met, found, strict=True) if not value < 1e-24]
    assert np.abs(slope).max() < 1e-11


def test_vertex_distance_is_the_mean_over_all_coordinates(sphere, at):
    target = sphere.vertices + random_like(sphere.vertices, 0)
    apart = np.asarray(sphere.vertices - target)
    still = at(sphere, sphere.vertices)
    assert np.isclose(sk.VertexDistance(target, sk.NoAlignment())(still, PASSIVE), np.mean(apart**2), rtol=1e-14)
    weights = np.arange(42.0)
    weighted = sk.VertexDistance(target, sk.NoAlignment(), weights)(still, PASSIVE)
    assert np.isclose(weighted, np.sum(weights @ apart**2) / weights.sum() / 3, rtol=1e-14)


def test_landmarks_leave_the_rest_alone(sphere, at):
    loss = sk.LandmarkDistance([3, 4], [[1.0, 0, 0], [0, 1, 0]], sk.NoAlignment())
    slope = jax.grad(lambda v: loss(at(sphere, v), PASSIVE))(sphere.vertices)
    gap = np.asarray(sphere.vertices)[[3, 4]] - [[1, 0, 0], [0, 1, 0]]
    assert np.isclose(loss(at(sphere, sphere.vertices), PASSIVE), np.mean(gap**2), rtol=1e-14)
    assert np.allclose(slope[jnp.array([3, 4])], gap / 3, atol=1e-15) and np.count_nonzero(slope) <= 6


def test_sphericity_of_an_ellipsoid(at):
    """Against the surface integral, by quadrature: the weights are areas, so that any fine mesh gives the same."""
    mesh = sk.meshes.icosphere(subdivisions=4)
    axes = np.array([0.8, 1.0, 1.3])
    z, around = np.meshgrid(*[(np.arange(400) + 0.5) / 400] * 2)
    z, around = 2 * z - 1, 2 * np.pi * around
    on_sphere = np.stack([np.sqrt(1 - z**2) * np.cos(around), np.sqrt(1 - z**2) * np.sin(around), z], axis=-1)
    weights = np.linalg.norm(on_sphere / axes, axis=-1)
    radii = np.linalg.norm(on_sphere * axes, axis=-1)
    mean = np.average(radii, weights=weights)
    expected = np.average((radii / mean - 1) ** 2, weights=weights)
    found = sk.Sphericity()(at(mesh, turned(7 * np.asarray(mesh.vertices) * axes)), PASSIVE)
    assert np.isclose(found, expected, rtol=5e-3)


def test_sphericity_is_finite_with_a_vertex_on_the_centre(at):
    mesh = sk.meshes.rectangle(2.0, 2.0, cells=(2, 2), diagonals="alternating")
    slope = jax.jit(jax.grad(lambda v: sk.Sphericity()(at(mesh, v), PASSIVE)))(mesh.vertices)
    assert np.isfinite(slope).all()


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_size_is_relative(scale, sphere, at):
    area, volume = (f(sphere.vertices, sphere) for f in (sk.surface_area, sk.enclosed_volume))
    here = at(sphere, scale * sphere.vertices)
    assert np.isclose(sk.Area(area)(here, PASSIVE), (scale**2 - 1) ** 2, rtol=1e-13)
    assert np.isclose(sk.Volume(volume)(here, PASSIVE), (scale**3 - 1) ** 2, rtol=1e-13)


def test_curvature_losses_weigh_by_area(sphere, at):
    v = sphere.vertices * jnp.array([0.9, 1.0, 1.1])
    weights = sk.voronoi_areas(v, sphere)
    mean, gauss = sk.mean_curvature(v, sphere), sk.gauss_curvature(v, sphere)
    expected = np.average((np.asarray(mean) - 0.5) ** 2, weights=weights)
    assert np.isclose(sk.MeanCurvature(0.5)(at(sphere, v), PASSIVE), expected, rtol=1e-13)
    expected = np.average((np.asarray(gauss) - 0.5) ** 2, weights=weights)
    assert np.isclose(sk.GaussCurvature(0.5)(at(sphere, v), PASSIVE), expected, rtol=1e-13)


def test_curvature_losses_leave_the_boundary_out(sheet, at):
    flat = sheet.vertices.at[:, 2].set(0.0)
    assert np.isclose(sk.MeanCurvature(0.3)(at(sheet, flat), PASSIVE), 0.09, rtol=1e-13)
    assert np.isclose(sk.GaussCurvature(0.3)(at(sheet, flat), PASSIVE), 0.09, rtol=1e-12)


def test_stretches_of_an_affine_map(sheet, at):
    """The singular values of the map, whatever the triangles and however turned; equal ones included."""
    flat = np.asarray(sheet.vertices) * [1, 1, 0]
    for shape in ([[1.2, 0.4], [0.1, 0.8]], [[1.3, 0.0], [0.0, 1.3]], [[1.0, 0.0], [0.0, 1e-9]]):
        mesh = sheet.with_vertices(flat)
        moved = flat.copy()
        moved[:, :2] = flat[:, :2] @ np.array(shape)
        larger, smaller = principal_stretches(at(mesh, turned(moved)))
        expected = np.linalg.svd(shape, compute_uv=False)
        assert np.allclose(larger, expected[0], rtol=1e-12) and np.allclose(smaller, expected[1], atol=1e-7)


def test_strain_limit_counts_what_lies_outside(sheet, at):
    mesh = sheet.with_vertices(sheet.vertices.at[:, 2].set(0.0))
    here = at(mesh, mesh.vertices * jnp.array([1.3, 0.8, 1.0]))
    evaluate = jax.jit(jax.value_and_grad(lambda v, limit: limit(at(mesh, v), PASSIVE)))
    for lower, upper, expected in (
        (0.9, 1.1, 0.2**2 + 0.1**2),
        (0.5, 1.1, 0.2**2),
        (0.0, 1.1, 0.2**2),
        (0.9, jnp.inf, 0.1**2),
        (0.7, 1.4, 0.0),
    ):
        value, slope = evaluate(here.vertices, sk.StrainLimit(lower, upper))
        assert np.isclose(value, expected, atol=1e-14) and np.isfinite(slope).all()


def test_strain_limit_where_both_stretches_are_equal(sheet, at):
    """Two bounds exceeded alike: the value is 2 (s - 1.1)^2 in the scale s, and smooth in it."""
    loss = sk.StrainLimit(lower=0.9, upper=1.1)
    value, slope = jax.jit(jax.value_and_grad(lambda s: loss(at(sheet, s * sheet.vertices), PASSIVE)))(1.4)
    assert np.isclose(value, 2 * 0.3**2, rtol=1e-12) and np.isclose(slope, 4 * 0.3, rtol=1e-12)


def test_strain_is_elastic(sheet, at):
    """Growth that the rest metric knows of is no strain."""
    grown = at(sheet, 1.5 * sheet.vertices, rest_metric=1.5**2 * at(sheet, sheet.vertices).rest.metric)
    assert sk.StrainLimit(lower=0.999, upper=1.001)(grown, PASSIVE) == 0


def test_fold_penalty_of_a_cube(at):
    """Twelve hinges of a right angle: l^2 / A = 1 / (1 / 3) each. The same at any size."""
    corners = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
    sides = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    cube = sk.Mesh(corners, [face for a, b, c, d in sides for face in ((a, b, c), (a, c, d))])
    for size in (1e-3, 1.0, 50.0):
        found = sk.FoldPenalty()(at(cube, size * cube.vertices), PASSIVE)
        assert np.isclose(found, 12 * 3 * (np.pi / 2) ** 2, rtol=1e-13)


def test_fold_penalty_spares_the_boundary(sheet, at):
    flat = sheet.vertices.at[:, 2].set(0.0)
    assert sk.FoldPenalty()(at(sheet, flat), PASSIVE) == 0


@pytest.mark.parametrize("degrees", [0, 20, 90, 170, 180])
def test_smoothness_of_two_faces(degrees, at):
    """|Q - Q'|^2 = 2 sin^2 of the angle between the directors."""
    mesh = sk.meshes.rectangle(1.0, 1.0, cells=(1, 1))
    angle = np.deg2rad(degrees)
    directions = jnp.asarray([[1.0, 0, 0], [np.cos(angle), np.sin(angle), 0]])
    field = sk.Nematic(angle=sk.director_angles(mesh, directions), stretch=jnp.asarray(1.1))
    here = at(mesh, mesh.vertices)
    expected = 2 * np.sin(angle) ** 2
    assert np.isclose(sk.DirectorSmoothness()(here, field), expected, atol=1e-14)
    assert np.isclose(sk.DirectorSmoothness()(here, sk.Bilayer(top=field, bottom=field)), 2 * expected, atol=1e-14)


def test_smoothness_is_a_mean_over_interior_edges(sheet, at, bilayer):
    actuation = bilayer(sheet)
    expected = 0.0
    for layer in (actuation.top, actuation.bottom):
        d = np.asarray(sk.directors(sheet, layer.angle))
        q = d[:, :, None] * d[:, None, :] - np.eye(3) / 2
        pairs = [pair for pair in np.asarray(sheet.edge_faces) if pair[1] >= 0]
        expected += np.mean([np.sum((q[f] - q[g]) ** 2) for f, g in pairs])
    assert np.isclose(sk.DirectorSmoothness()(at(sheet, sheet.vertices), actuation), expected, rtol=1e-13)


def test_smoothness_knows_neither_heads_nor_the_relaxed_shape(sphere, at, bilayer):
    actuation = bilayer(sphere).top
    flip = jnp.asarray(np.random.default_rng(1).integers(0, 2, sphere.n_faces) * np.pi)
    other = sk.Nematic(angle=actuation.angle + flip, stretch=actuation.stretch)
    value = sk.DirectorSmoothness()(at(sphere, sphere.vertices), actuation)
    assert np.isclose(sk.DirectorSmoothness()(at(sphere, 2 * sphere.vertices[::-1]), other), value, rtol=1e-12)
