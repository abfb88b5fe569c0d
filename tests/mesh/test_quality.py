"""The report on a mesh, against shapes whose every angle and area is known."""

import numpy as np
import pytest

from shellkit import meshes
from shellkit._mesh import Mesh


def test_one_right_triangle():
    report = Mesh([[0, 0, 0], [3, 0, 0], [0, 4, 0]], [[0, 1, 2]]).quality()
    assert np.allclose(report.angles, [[90, np.degrees(np.arctan2(4, 3)), np.degrees(np.arctan2(3, 4))]])
    assert report.area == 6 and np.allclose(sorted(report.edge_lengths), [3, 4, 5])
    # The inscribed circle has radius 1; that of an equilateral triangle of side 5 has 5 / (2 sqrt 3).
    assert np.isclose(report.aspect_ratios[0], 5 / (2 * np.sqrt(3)))
    assert report.volume is None and report.is_outward is None and not report.is_closed


def test_an_icosahedron():
    report = meshes.icosphere(0, radius=2.0).quality()
    edge = 2 / np.sin(2 * np.pi / 5)
    assert np.allclose(report.edge_lengths, edge) and np.allclose(report.angles, 60)
    assert np.allclose(report.aspect_ratios, 1)
    assert np.isclose(report.area, 5 * np.sqrt(3) * edge**2)
    assert np.isclose(report.volume, 5 * (3 + np.sqrt(5)) / 12 * edge**3)


def test_volume_far_from_the_origin_keeps_its_digits():
    mesh = meshes.icosphere(0)
    moved = mesh.with_vertices(np.asarray(mesh.vertices) + 1e6)
    assert np.isclose(moved.quality().volume, mesh.quality().volume, rtol=1e-8)


@pytest.mark.parametrize(
    "mesh, loops, genus, euler",
    [
        (meshes.icosphere(1), 0, 0, 2),
        (meshes.torus(1.0, 0.4, 0.4), 0, 1, 0),
        (meshes.disc(1.0, 0.4), 1, 0, 1),
        (meshes.annulus(0.5, 1.0, 0.3), 2, 0, 0),
        (meshes.annulus(0.5, 1.0, 0.3, slit=True), 1, 0, 1),
        (meshes.cylinder(1.0, 1.0, cells=(6, 2)), 2, 0, 0),
    ],
)
def test_topology(mesh, loops, genus, euler):
    report = mesh.quality()
    assert (report.n_boundary_loops, report.genus, report.euler_characteristic) == (loops, genus, euler)
    assert report.n_boundary_loops == len(mesh.boundary_loops())
    assert report.n_components == 1 and report.is_closed == mesh.is_closed == (loops == 0)


def test_pieces_are_counted():
    ball = meshes.icosphere(0)
    two = Mesh(
        np.concatenate([ball.vertices, np.asarray(ball.vertices) + 5]), np.concatenate([ball.faces, ball.faces + 12])
    )
    report = two.quality()
    assert report.n_components == 2 and report.genus == 0 and report.euler_characteristic == 4


def test_collapsed_faces_are_found_and_reported():
    mesh = meshes.icosphere(1)
    vertices = np.array(mesh.vertices)
    vertices[mesh.faces[7, 0]] = vertices[mesh.faces[7, 1]]
    report = mesh.with_vertices(vertices).quality()
    collapsed = [f for f in range(80) if {int(mesh.faces[7, 0]), int(mesh.faces[7, 1])} <= set(map(int, mesh.faces[f]))]
    assert report.degenerate_faces.tolist() == collapsed
    assert np.isinf(report.aspect_ratios[7])
    assert f"degenerate    {collapsed[0]}, {collapsed[1]}" in str(report)


def test_the_text_says_what_matters():
    text = str(meshes.icosphere(1).flipped().quality())
    assert "42 vertices, 120 edges, 80 faces" in text
    assert "closed, genus 0" in text and "INWARD" in text and "degenerate    none" in text
