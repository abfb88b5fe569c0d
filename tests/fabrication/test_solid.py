"""Thickened shells against bodies whose volume is known."""

import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk


def volume(mesh):
    return float(sk.enclosed_volume(mesh.vertices, mesh))


def test_a_sheet_becomes_a_plate(tmp_path):
    sheet = sk.meshes.rectangle(3.0, 2.0, cells=(3, 2), diagonals="alternating")
    plate = sk.thicken(sheet, 0.25)
    assert plate.is_closed
    assert volume(plate) == pytest.approx(1.5, rel=1e-12)
    assert float(sk.surface_area(plate.vertices, plate)) == pytest.approx(2 * 6 + 10 * 0.25, rel=1e-12)
    np.testing.assert_allclose(np.ptp(np.asarray(plate.vertices), axis=0), [3, 2, 0.25], rtol=1e-12)
    plate.write(tmp_path / "plate.stl")
    assert sk.Mesh.read(tmp_path / "plate.stl").is_closed  # corners that coincide are merged: no gap, no overlap


@pytest.mark.parametrize("thickness", [0.1, 0.2])
def test_a_shell_becomes_a_body_with_a_cavity(thickness):
    ball = sk.meshes.icosphere(subdivisions=3)
    body = sk.thicken(ball, thickness)
    assert body.is_closed and body.n_faces == 2 * ball.n_faces
    area = float(sk.surface_area(ball.vertices, ball))
    exact = 4 / 3 * np.pi * ((1 + thickness / 2) ** 3 - (1 - thickness / 2) ** 3)
    assert volume(body) == pytest.approx(exact, rel=8e-3)  # faces of 0.15 on a sphere lose so much area
    # Of second order in the thickness: h A (1 + h² K / 12).
    assert volume(body) / (area * thickness) - 1 == pytest.approx(thickness**2 / 12, rel=0.05)


def test_a_tube_has_walls_at_both_ends():
    tube = sk.meshes.cylinder(1.0, 3.0, cells=(40, 12))
    pipe = sk.thicken(tube, 0.3)
    assert pipe.is_closed and pipe.n_faces == 2 * tube.n_faces + 4 * 40
    area = float(sk.surface_area(tube.vertices, tube))
    assert volume(pipe) == pytest.approx(0.3 * area, rel=2e-3)
    np.testing.assert_allclose(np.abs(pipe.vertices[:, 2]).max(), 1.5, atol=1e-3)  # the faces lean a little


def test_edges_of_a_box_stay_sharp():
    corners = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    box = sk.Mesh(corners, [face for a, b, c, d in quads for face in ([a, b, c], [a, c, d])])
    hollow = sk.thicken(box, 0.2)
    np.testing.assert_allclose(np.unique(np.round(np.asarray(hollow.vertices), 12)), [-0.1, 0.1, 0.9, 1.1])
    assert volume(hollow) == pytest.approx(1.2**3 - 0.8**3, rel=1e-12)


def test_thickness_of_each_face():
    sheet = sk.meshes.rectangle(2.0, 1.0, cells=(40, 20))
    centre = np.asarray(sheet.vertices)[np.asarray(sheet.faces)].mean(axis=1)
    wedge = sk.thicken(sheet, 0.1 + 0.1 * centre[:, 0])
    assert volume(wedge) == pytest.approx(2 * 0.2, rel=1e-3)


def test_an_equilibrium_is_as_thick_as_it_was_made():
    sheet = sk.meshes.rectangle(2.0, 1.0, cells=(4, 2))
    problem = sk.InverseProblem(sheet, 0.1, sk.StVenantKirchhoff(1.0, 1.0))
    at_rest = problem.unrelaxed()
    assert volume(sk.thicken(problem)) == volume(sk.thicken(at_rest)) == pytest.approx(0.2, rel=1e-12)
    assert volume(sk.thicken(at_rest, 0.3)) == pytest.approx(0.6, rel=1e-12)


def test_what_is_wrong_is_said():
    ball = sk.meshes.icosphere(subdivisions=1)
    with pytest.raises(ValueError, match="no thickness of its own"):
        sk.thicken(ball)
    with pytest.raises(ValueError, match=r"shape \(3,\).*\(80,\)"):
        sk.thicken(ball, jnp.ones(3))
    with pytest.raises(ValueError, match="positive and finite"):
        sk.thicken(ball, -0.1)
    with pytest.raises(ValueError, match="cut through itself"):
        sk.thicken(ball, 2.5)
