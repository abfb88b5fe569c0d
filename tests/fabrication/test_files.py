"""What is written, read back by readers of the tests' own."""

import csv
import re
import xml.etree.ElementTree as ElementTree

import jax.numpy as jnp
import numpy as np
import pytest
from PIL import Image

import shellkit as sk


@pytest.fixture(scope="module")
def sheet():
    return sk.meshes.rectangle(30.0, 20.0, cells=(12, 8), diagonals="jittered")


@pytest.fixture(scope="module")
def layers(sheet):
    """Along x in the top layer, at 60 degrees from it in the bottom one."""
    top = sk.director_angles(sheet, jnp.array([1.0, 0.0, 0.0]))
    bottom = sk.director_angles(sheet, jnp.array([0.5, np.sqrt(0.75), 0.0]))
    return top, bottom


@pytest.fixture(scope="module")
def problem(sheet, layers):
    top, bottom = (sk.Nematic(angle=angle, stretch=0.9) for angle in layers)
    return sk.InverseProblem(sheet, 0.5, sk.StVenantKirchhoff(1.0, 1.0), actuation=sk.Bilayer(top, bottom))


def read_dxf(path):
    """The polylines of a DXF: layer, flags, points."""
    text = path.read_text().splitlines()
    assert len(text) % 2 == 0
    tags = [(int(code), value) for code, value in zip(text[::2], text[1::2], strict=True)]
    assert tags[-1] == (0, "EOF") and (1, "AC1009") in tags
    assert sum(tag == (0, "SECTION") for tag in tags) == sum(tag == (0, "ENDSEC") for tag in tags) == 3
    lines, kind = [], None
    for code, value in tags:
        if code == 0:
            kind = value
            if kind == "POLYLINE":
                lines.append({"layer": None, "flags": 0, "points": []})
            elif kind == "VERTEX":
                lines[-1]["points"].append([0.0, 0.0, 0.0])
        elif kind == "POLYLINE" and code == 8:
            lines[-1]["layer"] = value
        elif kind == "POLYLINE" and code == 70:
            lines[-1]["flags"] = int(value)
        elif kind == "VERTEX" and code in (10, 20, 30):
            lines[-1]["points"][-1][code // 10 - 1] = float(value)
    return [(line["layer"], line["flags"], np.array(line["points"])) for line in lines]


def read_svg(path):
    """Width and height in millimetres, and the lines of each group in them, with y upwards."""
    root = ElementTree.parse(path).getroot()
    name = "{http://www.w3.org/2000/svg}"
    width, height = (float(re.fullmatch(r"(.*)mm", root.get(side))[1]) for side in ("width", "height"))
    np.testing.assert_allclose([float(x) for x in root.get("viewBox").split()], [0, 0, width, height])
    groups = {}
    for group in root.findall(f"{name}g"):
        groups[group.get("id")] = []
        for each in group.findall(f"{name}path"):
            numbers = [float(x) for x in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", each.get("d"))]
            points = np.array(numbers).reshape(-1, 2) * [1, -1] + [0, height]
            groups[group.get("id")].append((points, each.get("d").endswith("Z")))
    return (width, height), groups


@pytest.mark.parametrize(("unit", "to_mm"), [("mm", 1.0), ("um", 1e-3), ("in", 25.4)])
def test_svg_is_to_scale(problem, tmp_path, unit, to_mm):
    lines = sk.export_streamlines(tmp_path / "a.svg", problem, spacing=2.0, unit=unit)
    (width, height), groups = read_svg(tmp_path / "a.svg")
    margin = 0.02 * 30 * to_mm
    np.testing.assert_allclose([width, height], np.array([30, 20]) * to_mm + 2 * margin, rtol=1e-5)
    assert list(groups) == ["outline", "top", "bottom"]
    ((outline, closed),) = groups["outline"]
    assert closed and len(outline) == 40
    np.testing.assert_allclose(np.ptp(outline, axis=0), np.array([30, 20]) * to_mm, rtol=1e-3)
    for layer in ("top", "bottom"):
        for (drawn, _), line in zip(groups[layer], lines[layer], strict=True):
            np.testing.assert_allclose(drawn, line[:, :2] * to_mm + margin, atol=2e-5)


def test_lines_in_a_drawing_are_parallel_to_the_directors_and_evenly_spaced(problem, tmp_path):
    sk.export_streamlines(tmp_path / "a.svg", problem, spacing=2.0)
    _, groups = read_svg(tmp_path / "a.svg")
    for layer, along in (("top", np.array([1.0, 0.0])), ("bottom", np.array([0.5, np.sqrt(0.75)]))):
        across = np.array([-along[1], along[0]])
        places = []
        for points, _ in groups[layer]:
            np.testing.assert_allclose(points @ across, (points @ across)[0], atol=1e-3)
            places.append((points @ across)[0])
        gaps = np.diff(np.sort(places))
        np.testing.assert_allclose(gaps, 2.0, atol=1e-3)


def test_dxf_of_a_flat_sheet(problem, tmp_path):
    lines = sk.export_streamlines(tmp_path / "a.dxf", problem, spacing=2.0, unit="cm")
    found = read_dxf(tmp_path / "a.dxf")
    assert [layer for layer, _, _ in found].count("OUTLINE") == 1
    for name in ("top", "bottom"):
        drawn = [points for layer, flags, points in found if layer == name.upper() and flags == 0]
        for points, line in zip(drawn, lines[name], strict=True):
            np.testing.assert_allclose(points, 10 * line, atol=1e-6)
    assert (tmp_path / "a.dxf").read_text().startswith("999\nlengths are in millimetres\n")


def test_dxf_of_a_curved_surface_and_vtp(tmp_path):
    import pyvista as pv

    tube = sk.meshes.cylinder(1.0, 2.0, cells=(24, 8))
    hoops = np.zeros(tube.n_faces)  # the first edges lie along the circumference
    lines = sk.export_streamlines(tmp_path / "a.dxf", tube, directors=hoops, spacing=0.3)["directors"]
    found = read_dxf(tmp_path / "a.dxf")
    drawn = [(flags, points) for layer, flags, points in found if layer == "DIRECTORS"]
    assert {flags for flags, _ in drawn} == {9}  # closed, of three dimensions
    for (_, points), line in zip(drawn, lines, strict=True):
        np.testing.assert_allclose(points, line[:-1], atol=1e-6)
        np.testing.assert_allclose(points[:, 2], points[0, 2], atol=1e-3)  # the faces lean a little
        assert (np.hypot(points[:, 0], points[:, 1]) > np.cos(np.pi / 24) - 1e-6).all()
    gaps = np.diff(np.sort([points[0, 2] for _, points in drawn]))
    np.testing.assert_allclose(gaps, 0.3, rtol=0.01)

    lines = sk.export_streamlines(tmp_path / "a.vtp", tube, directors=[hoops, hoops + 0.5 * np.pi], spacing=0.3)
    read = pv.read(tmp_path / "a.vtp")
    assert read.n_lines == len(lines["top"]) + len(lines["bottom"])
    np.testing.assert_array_equal(np.bincount(read.cell_data["layer"]), [len(lines["top"]), len(lines["bottom"])])
    np.testing.assert_allclose(read.get_cell(0).points, lines["top"][0], atol=1e-12)


def test_table(problem, tmp_path):
    assert sk.export_directors(tmp_path / "a.csv", problem, unit="um") == [tmp_path / "a.csv"]
    rows = list(csv.DictReader((tmp_path / "a.csv").read_text().splitlines()))
    column = lambda name: np.array([float(row[name]) for row in rows])
    assert len(rows) == problem.mesh.n_faces
    np.testing.assert_allclose(column("area (um^2)").sum(), 600.0, rtol=1e-12)
    corners = np.asarray(problem.mesh.vertices)[np.asarray(problem.mesh.faces)]
    for k, axis in enumerate("xyz"):
        np.testing.assert_allclose(column(f"{axis} (um)"), corners.mean(1)[:, k], atol=1e-12)
    np.testing.assert_allclose(np.minimum(column("top angle (deg)"), 180 - column("top angle (deg)")), 0, atol=1e-8)
    np.testing.assert_allclose(column("bottom angle (deg)"), 60, atol=1e-8)
    np.testing.assert_allclose(np.abs(column("bottom y")), np.sqrt(0.75), atol=1e-12)


def test_mesh_with_its_directors(problem, layers, tmp_path):
    sk.export_directors(tmp_path / "a.vtu", problem)
    read = sk.Mesh.read(tmp_path / "a.vtu")
    np.testing.assert_array_equal(read.vertices, problem.mesh.vertices)
    for name, angles in zip(("top", "bottom"), layers, strict=True):
        np.testing.assert_array_equal(read.face_data[f"{name} angle"], angles)
        np.testing.assert_allclose(read.face_data[f"{name} vector"], sk.directors(problem.mesh, angles), atol=1e-15)


def test_pictures_of_a_flat_sheet(tmp_path):
    disc = sk.meshes.disc(2.0, target_edge_length=0.2)
    at = np.asarray(disc.vertices)[np.asarray(disc.faces)].mean(axis=1)
    radial = np.asarray(sk.director_angles(disc, at))
    paths = sk.export_directors(tmp_path / "a.png", disc, directors=[radial, radial + np.pi / 2], pixel=0.05, unit="cm")
    assert paths == [tmp_path / "a-top.png", tmp_path / "a-bottom.png"]
    picture = Image.open(paths[0])
    np.testing.assert_allclose(picture.info["dpi"], 25.4 / 0.5, rtol=1e-3)  # pixels of half a millimetre
    levels, seen = np.moveaxis(np.asarray(picture, dtype=float), 2, 0)
    assert levels.shape == (80, 80)
    rows, columns = np.mgrid[:80, :80]
    x, y = (columns + 0.5) * 0.05 - 2, 2 - (rows + 0.5) * 0.05
    radius = np.hypot(x, y)
    assert (seen[radius < 1.95] == 255).all() and (seen[radius > 2.03] == 0).all()
    off = (levels * 180 / 256 - np.rad2deg(np.arctan2(y, x)) + 90) % 180 - 90
    # Within a face of 0.2 the angle differs from that at its centre.
    assert np.abs(off[(radius > 0.5) & (radius < 1.97)]).max() < np.rad2deg(0.15 / 0.5)
    other = np.asarray(Image.open(paths[1]), dtype=float)[..., 0]
    turned = (other - levels)[radius < 1.97] % 256
    np.testing.assert_allclose(turned, 128, atol=1)


def test_a_fit_and_a_mesh_are_designs_too(problem, sheet, layers, tmp_path):
    result = sk.FitResult(problem, 0.0, 0, None, problem, sk.History(), "steps", None)
    sk.export_directors(tmp_path / "a.csv", problem)
    sk.export_directors(tmp_path / "b.csv", result)
    sk.export_directors(tmp_path / "c.csv", sheet, directors=list(layers))
    text = (tmp_path / "a.csv").read_text()
    assert (tmp_path / "b.csv").read_text() == text == (tmp_path / "c.csv").read_text()


def test_what_is_wrong_is_said(problem, sheet, tmp_path):
    with pytest.raises(ValueError, match=r"there are no directors; give directors=angles"):
        sk.export_directors(tmp_path / "a.csv", sheet)
    with pytest.raises(ValueError, match=r"\.pdf.*none of \.svg, \.dxf, \.vtp"):
        sk.export_streamlines(tmp_path / "a.pdf", problem, spacing=1.0)
    with pytest.raises(FileNotFoundError, match="no folder"):
        sk.export_streamlines(tmp_path / "missing" / "a.svg", problem, spacing=1.0)
    ball = sk.meshes.icosphere(subdivisions=1)
    with pytest.raises(ValueError, match=r"\.svg is for flat sheets.*span 2 along z; write dxf or vtp"):
        sk.export_streamlines(tmp_path / "a.svg", ball, directors=np.zeros(80), spacing=0.1)
    with pytest.raises(ValueError, match=r"\.png is for flat sheets.*csv or vtu"):
        sk.export_directors(tmp_path / "a.png", ball, directors=np.zeros(80))
    with pytest.raises(ValueError, match="unit is 'mile'; choose one of 'mm'"):
        sk.export_directors(tmp_path / "a.csv", problem, unit="mile")
    with pytest.raises(ValueError, match="pixel is 0"):
        sk.export_directors(tmp_path / "a.png", problem, pixel=0.0)
