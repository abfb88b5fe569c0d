"""Closest points against what makes them so, and the search against every face."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk
from shellkit._geometry import closest as module
from shellkit._geometry.closest import closest_points, host_closest, nearest_points, normal_projections, search_faces


RANDOM = np.random.default_rng(4)
SPHERE = sk.meshes.icosphere(subdivisions=2)


def soup(count=300):
    """Triangles of very different size and shape that share no corner, some of them without area."""
    size = 10 ** RANDOM.uniform(-3, 0, (count, 1, 1))
    corners = RANDOM.normal(size=(count, 1, 3)) + size * RANDOM.normal(size=(count, 3, 3))
    corners[:5, 2] = corners[:5, 1]
    corners[5:8, 1:] = corners[5:8, :1]
    return corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


SURFACES = {
    "sphere": (np.asarray(SPHERE.vertices), np.asarray(SPHERE.faces)),
    "soup": soup(),
    "one face": (np.eye(3), np.array([[0, 1, 2]])),
}
POINTS = {
    "near": RANDOM.normal(size=(200, 3)),
    "far": 50 * RANDOM.normal(size=(50, 3)),
    "in the middle": 1e-9 * RANDOM.normal(size=(20, 3)),
}


@pytest.mark.parametrize("library", ["scipy", "igl"])
@pytest.mark.parametrize("points", POINTS)
@pytest.mark.parametrize("surface", SURFACES)
def test_no_face_is_nearer_than_the_one_found(surface, points, library, monkeypatch):
    if library == "igl":
        pytest.importorskip("igl")
    else:
        monkeypatch.setattr(module, "_igl", lambda: None)
    (vertices, faces), points = SURFACES[surface], POINTS[points]
    found = search_faces(points, vertices, faces)
    every = [host_closest(np.broadcast_to(p, (len(faces), 3)), vertices[faces])[1].min() for p in points]
    closest, squared = host_closest(points, vertices[faces[found]])
    assert np.allclose(np.sqrt(squared), np.sqrt(every), rtol=1e-12, atol=1e-14)
    assert np.allclose(np.linalg.norm(points - closest, axis=1), np.sqrt(squared), rtol=1e-12)


@pytest.mark.parametrize("points", POINTS)
def test_the_closest_point_of_a_triangle_is_optimal(points):
    """A point of a convex set is the nearest one if and only if no corner lies further towards the point."""
    vertices, faces = SURFACES["soup"]
    points = POINTS[points]
    face = RANDOM.integers(0, len(faces), len(points))
    corners = vertices[faces[face]]
    closest, _ = host_closest(points, corners)
    beyond = np.einsum("nx,nkx->nk", points - closest, corners - closest[:, None])
    size = 1 + np.abs(points).max()
    assert beyond.max() < 1e-13 * size**2
    # Inside the triangle: its weights, by least squares, are none of them negative, and give the point back.
    for p, c in zip(closest, corners, strict=True):
        weights = np.linalg.lstsq(np.vstack([c.T, np.ones(3)]), np.append(p, 1), rcond=None)[0]
        off = np.linalg.norm(c, axis=1).max() * 1e-9
        assert weights.min() > -1e-6 or np.linalg.matrix_rank(c[1:] - c[0], tol=1e-9) < 2
        assert np.linalg.norm(weights @ c - p) < off


def test_in_jax_as_on_the_host():
    vertices, faces = SURFACES["soup"]
    points = jnp.asarray(POINTS["near"])
    found = jax.jit(closest_points)(points, jnp.asarray(vertices), jnp.asarray(faces))
    expected, _ = host_closest(np.asarray(points), vertices[faces[np.asarray(found.faces)]])
    assert np.allclose(found.points, expected, atol=1e-12)
    assert np.allclose(found.weights.sum(axis=1), 1, atol=1e-14) and found.weights.min() > -1e-15


def test_derivatives_against_differences():
    """In points and corners, to second order; and the first against the projections given by hand."""
    vertices, faces = (jnp.asarray(a) for a in SURFACES["sphere"])
    points = jnp.asarray(1.3 * RANDOM.normal(size=(40, 3)))
    x = (points, vertices + 0.02 * RANDOM.normal(size=vertices.shape))
    direction = jax.tree.map(lambda leaf: jnp.asarray(RANDOM.normal(size=leaf.shape)), x)
    weights = jnp.asarray(RANDOM.normal(size=points.shape))

    def value(x):
        return jnp.sum(weights * closest_points(*x, faces).points)

    def slope(x):
        return sum(jnp.vdot(g, d) for g, d in zip(jax.grad(value)(x), direction, strict=True))

    @jax.jit
    def all_of_them(x):
        second = jax.jvp(slope, (x,), (direction,))[1]
        moved = jax.vmap(lambda e: jax.jvp(lambda p: p - closest_points(p, x[1], faces).points, (x[0],), (e,))[1])
        projections = moved(jnp.broadcast_to(jnp.eye(3)[:, None], (3, *points.shape)))
        by_hand = normal_projections(closest_points(*x, faces), x[1], faces)
        return value(x), slope(x), second, jnp.moveaxis(projections, 0, 2), by_hand

    step = 1e-6
    here, up, down = (all_of_them(jax.tree.map(lambda a, d, s=s: a + s * step * d, x, direction)) for s in (0, 1, -1))
    assert np.isclose(here[1], (up[0] - down[0]) / (2 * step), rtol=1e-7)
    assert np.isclose(here[2], (up[1] - down[1]) / (2 * step), rtol=1e-6)
    assert np.allclose(here[3], here[4], atol=1e-12)
    kinds = np.round(np.trace(here[4], axis1=1, axis2=2))
    assert set(kinds) == {1, 2, 3}, "faces, edges and corners should all have been met"


def test_nearest_points_and_what_is_not_finite():
    points, target = RANDOM.normal(size=(30, 3)), RANDOM.normal(size=(50, 3))
    expected = np.linalg.norm(points[:, None] - target, axis=2).argmin(axis=1)
    assert np.array_equal(nearest_points(jnp.asarray(points), jnp.asarray(target)), expected)
    points[3] = np.nan
    found = nearest_points(jnp.asarray(points), jnp.asarray(target))
    assert np.array_equal(np.delete(found, 3), np.delete(expected, 3))
    vertices, faces = SURFACES["one face"]
    assert np.isnan(closest_points(jnp.asarray(points), jnp.asarray(vertices), jnp.asarray(faces)).points[3]).all()
