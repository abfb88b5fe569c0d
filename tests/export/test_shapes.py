"""Relaxed shapes and series of them, as ParaView and pyvista read them."""

import os
import warnings

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import pyvista

import shellkit as sk


MESH = sk.meshes.rectangle(2.0, 1.0, cells=(4, 2))
ALONG_X = sk.director_angles(MESH, jnp.array([1.0, 0.0, 0.0]))
PROBLEM = sk.InverseProblem(
    mesh=MESH,
    thickness=0.05,
    energy=sk.StVenantKirchhoff(alpha=1.0, beta=2.0) + sk.Bending(alpha=1.0, beta=1.0),
    actuation=sk.Bilayer(sk.Nematic(ALONG_X, 1.0), sk.Nematic(ALONG_X + jnp.pi / 4, 1.0)),
)
TILT = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])


def stretched(along, across):
    """The sheet drawn out along x and along y, then tilted: nothing is relaxed."""
    moved = (MESH.vertices * jnp.array([along, across, 1.0])) @ TILT
    return eqx.tree_at(lambda e: e.vertices, PROBLEM.unrelaxed(), moved)


@pytest.mark.parametrize("extension", ["vtu", "vtp", "vtk"])
def test_fields_of_a_stretched_sheet(tmp_path, extension):
    at = stretched(1.1, 0.95)
    at.write(tmp_path / f"m.{extension}", problem=PROBLEM)
    grid = pyvista.read(tmp_path / f"m.{extension}")
    assert os.listdir(tmp_path) == [f"m.{extension}"]
    assert np.array_equal(grid.points, at.vertices) and grid.n_cells == MESH.n_faces
    assert np.allclose(grid.point_data["displacement"], at.vertices - MESH.vertices, atol=1e-15)
    assert np.allclose(grid.cell_data["thickness"], 0.05)
    assert np.allclose(grid.cell_data["principal_strains"], [0.1, -0.05], atol=1e-12)
    strain = TILT.T @ np.diag([0.1, -0.05, 0.0]) @ TILT
    assert np.allclose(grid.cell_data["strain"].reshape(-1, 3, 3), strain, atol=1e-12)
    e1, e2 = sk.face_frames(at.vertices, MESH)
    frames = np.stack([e1, e2], axis=2)
    flat = np.asarray(sk.membrane_stress(PROBLEM, at))
    stress = grid.cell_data["stress"].reshape(-1, 3, 3)
    assert np.allclose(stress, frames @ flat @ frames.transpose(0, 2, 1), atol=1e-12)
    xx, yy = (axis @ stress @ axis for axis in TILT[:2])
    assert np.allclose(grid.cell_data["von_mises"], np.sqrt(xx**2 - xx * yy + yy**2), rtol=1e-9)
    assert np.allclose(grid.cell_data["energy_density"], sk.energy_density(PROBLEM, at))
    # An arrow along x stays along x; one between the axes is turned towards the longer one.
    assert np.allclose(np.abs(grid.cell_data["top_director"] @ TILT[0]), 1.0)
    between = np.array([1.1, 0.95]) / np.hypot(1.1, 0.95)
    carried = grid.cell_data["bottom_director"] @ TILT[:2].T
    assert np.allclose(carried * np.sign(carried[:, :1]), between, atol=1e-12)


def test_without_a_problem_there_is_what_the_shape_has(tmp_path):
    stretched(1.1, 1.0).write(tmp_path / "m.vtu")
    grid = pyvista.read(tmp_path / "m.vtu")
    assert set(grid.point_data) == {"displacement"}
    assert {name for name in grid.cell_data} == {"thickness", "strain", "principal_strains"}


@pytest.mark.parametrize("extension", ["ply", "obj", "stl", "off", "msh"])
def test_other_formats_have_the_shape_without_complaint(tmp_path, extension):
    at = stretched(1.1, 1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        at.write(tmp_path / f"m.{extension}", problem=PROBLEM)
    back = sk.Mesh.read(tmp_path / f"m.{extension}")
    assert np.allclose(back.vertices[back.faces], at.vertices[MESH.faces], atol=1e-15)


def test_the_problem_of_another_mesh_is_refused(tmp_path):
    other = PROBLEM.replace(mesh=sk.meshes.rectangle(1.0, 1.0, cells=(1, 1)), actuation=None)
    with pytest.raises(ValueError, match="the problem has 2 faces, and the equilibrium 16"):
        stretched(1.1, 1.0).write(tmp_path / "m.vtu", problem=other)


def shapes_of(path):
    reader = pyvista.get_reader(path)
    for time in reader.time_values:
        reader.set_active_time_value(time)
        yield time, reader.read()[0]


def test_a_path_is_a_series_in_progress(tmp_path):
    shapes = (stretched(1.05, 1.0), stretched(1.1, 1.0))
    path = sk.Path(jnp.array([0.5, 1.0]), shapes, ())
    assert sk.write_series(tmp_path / "ramp.pvd", path, problem=PROBLEM) == tmp_path / "ramp.pvd"
    assert sorted(os.listdir(tmp_path)) == ["ramp", "ramp.pvd"]
    assert sorted(os.listdir(tmp_path / "ramp")) == ["ramp_0000.vtu", "ramp_0001.vtu"]
    read = list(shapes_of(tmp_path / "ramp.pvd"))
    assert [time for time, _ in read] == [0.5, 1.0]
    for (_, grid), at in zip(read, shapes, strict=True):
        assert np.array_equal(grid.points, at.vertices) and "stress" in grid.cell_data
    sk.write_series(tmp_path / "ramp.pvd", list(shapes[:1]), times=[3.0])  # a shorter one in its place
    assert [time for time, _ in shapes_of(tmp_path / "ramp.pvd")] == [3.0]


def test_a_fit_is_a_series_by_its_steps(tmp_path):
    film = sk.Snapshots(every=2)
    for step, stretch in enumerate((1.0, 1.1, 1.2)):
        film(sk.FitStep(step, 3, PROBLEM, None if step == 0 else stretched(stretch, 1.0), 0.0, {}, sk.History()))
    sk.write_series(tmp_path / "fit.pvd", film)
    read = list(shapes_of(tmp_path / "fit.pvd"))
    assert [time for time, _ in read] == [0.0, 2.0]
    assert np.allclose(read[0][1].points, MESH.vertices) and np.allclose(read[1][1].points, stretched(1.2, 1).vertices)
    best = sk.FitResult(PROBLEM, 0.0, 4, stretched(1.3, 1.0), PROBLEM, sk.History(), "steps", None)
    sk.write_series(tmp_path / "best.pvd", best)
    ((time, grid),) = shapes_of(tmp_path / "best.pvd")
    assert time == 4.0 and "von_mises" in grid.cell_data


def test_what_is_no_series_is_refused(tmp_path):
    at = stretched(1.1, 1.0)
    with pytest.raises(ValueError, match=r"a series is a \.pvd file, as .*film\.pvd"):
        sk.write_series(tmp_path / "film.vtu", [at])
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        sk.write_series(tmp_path / "none" / "film.pvd", [at])
    with pytest.raises(ValueError, match=r"a list is no series.*equilibrium\.write"):
        sk.write_series(tmp_path / "film.pvd", [MESH])
    with pytest.raises(ValueError, match="there are no frames"):
        sk.write_series(tmp_path / "film.pvd", sk.Snapshots())
    for times in ([0.0], [1.0, 1.0]):
        with pytest.raises(ValueError, match=f"{len(times)} times for 2 frames; give one for each, rising"):
            sk.write_series(tmp_path / "film.pvd", [at, at], times=times)
    assert os.listdir(tmp_path) == []


def test_a_failed_frame_leaves_no_list(tmp_path, monkeypatch):
    """The list is written last, so that it never names what is not there."""
    at = stretched(1.1, 1.0)
    monkeypatch.setattr("shellkit._mesh.formats.vtk.write", lambda path, content: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        sk.write_series(tmp_path / "film.pvd", [at])
    assert not (tmp_path / "film.pvd").exists() and os.listdir(tmp_path / "film") == []
