"""Connectivity against a slow one in plain Python, under any numbering; what is no surface is refused by its place."""

import hypothesis as hp
import hypothesis.strategies as st
import numpy as np
import pytest

from shellkit import meshes
from shellkit._mesh import Mesh


SURFACES = {
    "triangle": Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]),
    "sphere": meshes.icosphere(1),
    "torus": meshes.torus(1.0, 0.4, cells=(5, 4)),
    "disc": meshes.disc(1.0, 0.5),
    "annulus": meshes.annulus(0.5, 1.0, 0.4),
    "two discs": Mesh(
        np.concatenate([meshes.disc(1.0, 0.6).vertices, np.asarray(meshes.disc(1.0, 0.6).vertices) + 3]),
        np.concatenate(
            [meshes.disc(1.0, 0.6).faces, np.asarray(meshes.disc(1.0, 0.6).faces) + meshes.disc(1.0, 0.6).n_vertices]
        ),
    ),
}


def plain_connectivity(faces):
    """Sides as (face, corner opposite), by the undirected edge they lie on."""
    sides = {}
    for f, (a, b, c) in enumerate(faces.tolist()):
        for corner, (tail, head) in enumerate(((b, c), (c, a), (a, b))):
            sides.setdefault(frozenset((tail, head)), []).append((f, corner, tail, head))
    return sides


def check_connectivity(mesh):
    faces = np.asarray(mesh.faces)
    sides = plain_connectivity(faces)
    assert mesh.n_edges == len(sides)
    number = {frozenset(edge): e for e, edge in enumerate(np.asarray(mesh.edges).tolist())}
    assert number.keys() == sides.keys()
    for edge, e in number.items():
        first, *rest = sorted(sides[edge])
        f, corner, tail, head = first
        second, second_corner = rest[0][:2] if rest else (-1, -1)
        assert np.asarray(mesh.edges)[e].tolist() == [tail, head]
        assert np.asarray(mesh.edge_faces)[e].tolist() == [f, second]
        assert np.asarray(mesh.edge_corners)[e].tolist() == [corner, second_corner]
        for here, there in ((first, rest[0] if rest else None), (rest[0] if rest else None, first)):
            if here is None:
                continue
            f, corner, _, _ = here
            assert mesh.face_edges[f, corner] == e
            assert mesh.twins[f, corner] == (-1 if there is None else 3 * there[0] + there[1])
            assert mesh.face_opposite[f, corner] == (-1 if there is None else faces[there[0], there[1]])
    on_boundary = {v for edge, at in sides.items() if len(at) == 1 for v in edge}
    assert np.flatnonzero(np.asarray(mesh.boundary_vertices)).tolist() == sorted(on_boundary)
    assert mesh.is_closed == (not on_boundary)
    assert int(mesh.boundary_edges.sum()) == sum(len(at) == 1 for at in sides.values())


@pytest.mark.parametrize("name", SURFACES)
def test_plain_python_finds_the_same(name):
    check_connectivity(SURFACES[name])


@hp.settings(max_examples=15, deadline=None)
@hp.given(st.sampled_from(sorted(SURFACES)), st.randoms(use_true_random=False))
def test_any_numbering_connects_the_same_surface(name, random):
    mesh = SURFACES[name]
    rename = np.array(random.sample(range(mesh.n_vertices), mesh.n_vertices))
    order = np.array(random.sample(range(mesh.n_faces), mesh.n_faces))
    turns = np.array([random.randrange(3) for _ in order])
    faces = rename[np.asarray(mesh.faces)[order]]
    faces = np.take_along_axis(faces, (turns[:, None] + np.arange(3)) % 3, axis=1)
    vertices = np.empty_like(mesh.vertices)
    vertices[rename] = mesh.vertices
    other = Mesh(vertices, faces)
    assert np.array_equal(other.faces, faces)  # order and first corners are the user's
    check_connectivity(other)
    assert other.quality().euler_characteristic == mesh.quality().euler_characteristic


def test_an_edge_is_numbered_by_its_vertices_whatever_the_faces():
    mesh = SURFACES["sphere"]
    shuffled = Mesh(mesh.vertices, np.asarray(mesh.faces)[::-1])
    assert np.array_equal(np.sort(mesh.edges, axis=1), np.sort(shuffled.edges, axis=1))


def refused(faces, vertices=None, **data):
    good = SURFACES["sphere"]
    with pytest.raises(ValueError) as error:
        Mesh(good.vertices if vertices is None else vertices, faces, **data)
    return str(error.value)


def with_flipped(*flipped):
    faces = np.array(SURFACES["sphere"].faces)
    faces[list(flipped)] = faces[list(flipped)][:, ::-1]
    return faces


FACES = np.asarray(SURFACES["sphere"].faces)
VERTICES = np.asarray(SURFACES["sphere"].vertices)


@pytest.mark.parametrize("flipped", [(0,), (3,), (79,), (5, 60), tuple(range(41, 80))])
def test_the_faces_to_reverse_are_named(flipped):
    message = refused(with_flipped(*flipped))
    assert "inconsistent orientation" in message
    listed = message.split("faces[i, ::-1]: ")[1].rstrip(".")
    wanted = ", ".join(map(str, flipped[:20])) + (f" and {len(flipped) - 20} more" if len(flipped) > 20 else "")
    assert listed == wanted


def test_a_one_sided_surface_is_told_apart():
    strip = [[i, (i + 1) % 5, (i + 2) % 5] for i in range(5)]
    assert "one-sided" in refused(strip, np.random.default_rng(0).normal(size=(5, 3)))


def test_an_edge_of_three_faces_is_named_with_its_faces():
    a, b = FACES[0, :2]
    message = refused(np.vstack([FACES, [[a, b, 42]]]), np.vstack([VERTICES, [[0, 0, 3]]]))
    other = next(f for f in range(1, 80) if {a, b} <= set(FACES[f]))
    assert f"edge ({a}, {b})" in message and f"3 faces: 0, {other}, 80" in message


def test_a_repeated_face_is_named_whichever_way_it_runs():
    assert "faces 4 and 80" in refused(np.vstack([FACES, np.roll(FACES[4], 1)]))
    assert "faces 4 and 80" in refused(np.vstack([FACES, FACES[4, ::-1]]))


def test_a_vertex_where_two_surfaces_touch_is_named():
    vertices = np.random.default_rng(0).normal(size=(5, 3))
    message = refused([[3, 1, 2], [3, 4, 0]], vertices)
    assert "vertex 3" in message and "face 0 and one with face 1" in message
    # Two closed surfaces that share a vertex look closed everywhere.
    joined = np.where(FACES == 41, 0, FACES + 42 - (FACES > 41))
    assert "2 separate fans" in refused(np.vstack([FACES, joined]), np.vstack([VERTICES, VERTICES[:41] + 3]))


@pytest.mark.parametrize(
    "words, faces",
    [
        (("index out of range", "face 0", "99"), np.where(FACES == FACES[0, 1], 99, FACES)),
        (("index out of range", "face 2", "-1"), np.where(np.arange(80)[:, None] == 2, -1, FACES)),
        (("repeated corner", "face 80", "[1, 1, 2]"), np.vstack([FACES, [[1, 1, 2]]])),
        (("shape (80, 2)", "(F, 3)"), FACES[:, :2]),
        (("shape (0, 3)",), FACES[:0]),
        (("float64", "integer"), FACES.astype(float)),
    ],
)
def test_faces_that_cannot_be_are_refused(words, faces):
    message = refused(faces)
    assert all(word in message for word in words), message


def test_vertices_that_cannot_be_are_refused():
    for bad in (np.nan, np.inf):
        vertices = VERTICES.copy()
        vertices[7, 1] = bad
        assert "vertex 7" in refused(FACES, vertices)
    assert "vertex 42, 43" in refused(FACES, np.vstack([VERTICES, np.ones((2, 3))]))
    assert "shape (42, 2)" in refused(FACES, VERTICES[:, :2])
    assert "complex" in refused(FACES, VERTICES + 0j)


def test_a_face_without_area_is_refused_and_a_needle_is_not():
    line = np.array([[0, 0, 0], [1, 1, 1], [3, 3, 3.0]])
    assert "face 0" in refused([[0, 1, 2]], line)
    assert "face 0" in refused([[0, 1, 2]], line[[0, 1, 1]])
    for height in (1e-4, 1e-12):
        Mesh([[0, 0, 0], [1, 0, 0], [0.5, height, 0]], [[0, 1, 2]])
    for scale in (1e-6, 1e6):
        Mesh(scale * VERTICES, FACES)


def test_data_of_another_length_is_refused():
    assert "vertex_data['heat'] has shape (80,); expected (42" in refused(FACES, vertex_data={"heat": np.zeros(80)})
    assert "face_data['angle'] has shape (42,); expected (80" in refused(FACES, face_data={"angle": np.zeros(42)})
    assert "face_data['angle'] has shape ()" in refused(FACES, face_data={"angle": 1.0})
