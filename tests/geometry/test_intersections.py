"""Faces that run through each other, on constructions with known answers."""

import numpy as np
import pytest

import shellkit as sk


def two(first, second):
    """Two triangles without a common vertex, as one mesh."""
    vertices = np.array([*first, *second], dtype=float)
    return vertices, sk.Mesh(vertices, np.array([[0, 1, 2], [3, 4, 5]]))


FLAT = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]


@pytest.mark.parametrize(
    "other, crosses",
    [
        ([(0.2, 0.2, -1), (0.3, 0.2, 1), (0.2, 0.3, 1)], True),  # pierces the inside
        ([(0.2, 0.2, 0.1), (0.3, 0.2, 1), (0.2, 0.3, 1)], False),  # above it
        ([(0.2, 0.2, 0), (0.3, 0.2, 1), (0.2, 0.3, 1)], False),  # a corner rests on it
        ([(0.2, 0.2, -1e-9), (0.3, 0.2, 1), (0.2, 0.3, 1)], True),  # a corner sunk in by little
        ([(0.9, 0.9, -1), (1, 0.9, 1), (0.9, 1, 1)], False),  # boxes overlap, faces do not
        ([(0.1, 0.1, 0), (0.4, 0.1, 0), (0.1, 0.4, 0)], True),  # in the same plane, one within the other
        ([(0.8, 0.8, 0), (1.8, 0.8, 0), (0.8, 1.8, 0)], False),  # in the same plane, apart
        ([(0.4, 0.4, 0), (1.4, 0.4, 0), (0.4, 1.4, 0)], True),  # in the same plane, overlapping
        ([(-1, 0.25, -1), (2, 0.25, -1), (0.5, 0.25, 2)], True),  # edges through each other's inside
        ([(2, -1, 0), (-1, 2, 0), (2, 2, 5)], False),  # an edge beside the long side
    ],
)
def test_two_triangles(other, crosses):
    for first, second in ((FLAT, other), (other, FLAT)):
        vertices, mesh = two(first, second)
        turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
        for x in (vertices, 1e6 * vertices @ turn + 3e6, 1e-6 * vertices):
            found = sk.self_intersections(x, mesh)
            assert found.tolist() == ([[0, 1]] if crosses else [])


def test_against_exact_segments():
    """Random pairs: the faces meet where an edge of one crosses the inside of the other, by signed volumes."""
    rng = np.random.default_rng(2)
    pairs = rng.normal(size=(300, 6, 3))
    volume = lambda a, b, c, d: np.linalg.det([b - a, c - a, d - a])

    def crosses(p, q, a, b, c):
        if volume(a, b, c, p) * volume(a, b, c, q) > 0:
            return False
        signs = [np.sign(volume(p, q, *e)) for e in ((a, b), (b, c), (c, a))]
        return abs(sum(signs)) == 3

    expected, found = [], []
    for x in pairs:
        s, t = x[:3], x[3:]
        hits = [crosses(u[i], u[i - 1], *w) for u, w in ((s, t), (t, s)) for i in range(3)]
        expected.append(any(hits))
        found.append(len(sk.self_intersections(*two(s, t))) == 1)
    assert 50 < sum(expected) < 250 and found == expected


def test_shells_at_rest_are_free_of_them():
    for mesh in (
        sk.meshes.icosphere(subdivisions=2),
        sk.meshes.rectangle(1.0, 1.0, cells=(5, 5), diagonals="jittered"),
    ):
        assert len(sk.self_intersections(mesh.vertices, mesh)) == 0


def test_a_folded_sheet_runs_through_itself():
    """A strip rolled up by one and a half turns without a pitch lies on itself; with one it is free of itself."""
    mesh = sk.meshes.rectangle(3.0, 0.5, cells=(24, 3))
    x, y = np.asarray(mesh.vertices)[:, :2].T
    angle = np.pi * x
    rolled = lambda pitch: np.column_stack([(1 + pitch * x) * np.cos(angle), y, (1 + pitch * x) * np.sin(angle)])
    assert len(sk.self_intersections(rolled(0.1), mesh)) == 0
    # A fold of 180 degrees on a row of edges: the flap lies upon the sheet.
    flat = np.asarray(mesh.vertices).copy()
    flat[:, 0] = np.where(flat[:, 0] > 1.5, 3.0 - flat[:, 0], flat[:, 0])
    pairs = sk.self_intersections(flat, mesh)
    assert len(pairs) > 0 and len(np.unique(pairs)) == mesh.n_faces
    # A tongue pushed through the sheet beside it: only those faces are named.
    tilted = np.asarray(mesh.vertices).copy()
    tilted[:, 2] = 0.3 * (np.where(tilted[:, 0] > 1.5, 3.0 - tilted[:, 0], tilted[:, 0]) - 0.77)
    tilted[:, 0] = np.where(tilted[:, 0] > 1.5, 3.0 - tilted[:, 0], tilted[:, 0])
    tilted[np.asarray(mesh.vertices)[:, 0] > 1.5, 2] *= -1
    centres = tilted[np.asarray(mesh.faces)].mean(axis=1)
    named = np.unique(sk.self_intersections(tilted, mesh))
    assert len(named) > 0 and np.abs(centres[named, 0] - 0.77).max() < 0.2


def test_neighbours_may_cross_too():
    """Two faces with one common corner, one of which runs through the other."""
    vertices = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0.4, 0.1, -0.3), (0.4, 0.3, 0.4)], dtype=float)
    mesh = sk.Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4]]))
    assert sk.self_intersections(vertices, mesh).tolist() == [[0, 2]]
    vertices[4, 2] = -0.2
    assert len(sk.self_intersections(vertices, mesh)) == 0


def test_positions_must_be_finite():
    vertices, mesh = two(FLAT, FLAT)
    vertices[4, 1] = np.nan
    with pytest.raises(ValueError, match="vertex 4"):
        sk.self_intersections(vertices, mesh)
