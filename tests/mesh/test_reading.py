"""Files as other programs write them: torn, noisy, in millimetres, of quads and strips. Each is read as the surface
that was meant, or refused with a remedy that works."""

import warnings

import numpy as np
import pytest
import pyvista

import shellkit as sk
from shellkit import meshes
from shellkit._mesh import Mesh, MeshFileError, MeshTopologyWarning


RANDOM = np.random.default_rng(7)
BALL = meshes.icosphere(2)
DISC = meshes.disc(1.0, target_edge_length=0.3)


def stl(path, corners):
    """A text stl of triangles, corners of shape (F, 3, 3)."""
    facet = "facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n"
    lines = ["".join("vertex {!r} {!r} {!r}\n".format(*corner) for corner in t) for t in corners.tolist()]
    path.write_text("solid\n" + "".join(map(facet.format, lines)) + "endsolid\n")


def obj(path, vertices, faces):
    rows = ["v {!r} {!r} {!r}".format(*v) for v in np.asarray(vertices).tolist()]
    rows += ["f " + " ".join(str(c + 1) for c in face) for face in faces]
    path.write_text("\n".join(rows) + "\n")


def quietly(path, **choices):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return Mesh.read(path, **choices)


def corners_of(mesh):
    return np.asarray(mesh.vertices)[np.asarray(mesh.faces)]


# --- Welding


@pytest.mark.parametrize("mesh", [BALL, DISC], ids=["ball", "disc"])
def test_a_noisy_stl_is_one_surface(tmp_path, mesh):
    noise = 2e-5 * RANDOM.uniform(-1, 1, (mesh.n_faces, 3, 3))
    stl(tmp_path / "m.stl", corners_of(mesh) + noise)
    read = quietly(tmp_path / "m.stl")
    assert (read.n_vertices, read.n_edges, read.n_faces) == (mesh.n_vertices, mesh.n_edges, mesh.n_faces)
    assert np.abs(corners_of(read) - corners_of(mesh)).max() < 2e-5 * np.sqrt(3)
    # Without: every triangle by itself, and that is said.
    with pytest.warns(MeshTopologyWarning, match=rf"in {mesh.n_faces} pieces.*{mesh.n_faces} boundary loops"):
        torn = Mesh.read(tmp_path / "m.stl", weld=0)
    assert torn.n_vertices == 3 * mesh.n_faces


def test_a_tolerance_reaches_further_than_the_default(tmp_path):
    stl(tmp_path / "m.stl", corners_of(BALL) + 0.01 * RANDOM.uniform(-1, 1, (BALL.n_faces, 3, 3)))
    with pytest.warns(MeshTopologyWarning, match=r"pieces"):
        Mesh.read(tmp_path / "m.stl")
    assert quietly(tmp_path / "m.stl", weld=0.04).n_vertices == BALL.n_vertices
    with pytest.raises(MeshFileError, match=r"weld=1 joins corners of the same face: .* of 320 faces.*shortest edge"):
        Mesh.read(tmp_path / "m.stl", weld=1.0)
    for wrong in (-1.0, np.nan):
        with pytest.raises(ValueError, match=r"weld is .*; give a distance"):
            Mesh.read(tmp_path / "m.stl", weld=wrong)


def test_an_exact_stl_is_read_to_the_last_digit(tmp_path):
    BALL.write(tmp_path / "m.stl")
    assert np.array_equal(corners_of(quietly(tmp_path / "m.stl")), corners_of(BALL))


def test_two_sheets_that_nearly_touch_stay_two(tmp_path):
    """The gap is less than what noise may be, but the sheets are whole as they are."""
    inner = BALL.with_vertices(BALL.vertices * (1 - 1e-5)).flipped()
    stl(tmp_path / "m.stl", np.concatenate([corners_of(BALL), corners_of(inner)]))
    with pytest.warns(MeshTopologyWarning, match="in 2 pieces") as caught:
        read = Mesh.read(tmp_path / "m.stl")
    assert read.n_vertices == 2 * BALL.n_vertices and "torn" not in str(caught[0].message)


@pytest.mark.parametrize("extension", ["ply", "obj", "off", "vtp", "msh"])
def test_an_unwelded_mesh_is_told_and_welded_on_request(tmp_path, extension):
    path = tmp_path / f"m.{extension}"
    heat = RANDOM.normal(size=BALL.n_faces)
    soup = Mesh(corners_of(BALL).reshape(-1, 3), np.arange(3 * BALL.n_faces).reshape(-1, 3), face_data={"heat": heat})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        soup.write(path)
    torn = 3 * BALL.n_faces - BALL.n_vertices
    with pytest.warns(MeshTopologyWarning, match=rf"{torn} vertices lie where another one does.*weld=True"):
        assert Mesh.read(path).n_vertices == 3 * BALL.n_faces
    welded = quietly(path, weld=True)
    assert welded.n_vertices == BALL.n_vertices and welded.is_closed
    assert np.array_equal(corners_of(welded), corners_of(BALL))
    if extension in ("ply", "vtp", "msh"):
        assert np.array_equal(welded.face_data["heat"], heat)


def test_faces_that_welding_empties_go_with_their_data(tmp_path):
    vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1, 1, 0.0]]
    faces = [[0, 1, 2], [1, 4, 2], [0, 2, 3], [3, 0, 4]]
    obj(tmp_path / "m.obj", vertices, faces)
    with pytest.warns(MeshTopologyWarning, match="2 faces without area or given twice were left out"):
        read = Mesh.read(tmp_path / "m.obj", weld=0)
    assert read.faces.tolist() == [[0, 1, 2], [0, 2, 3]] and read.n_vertices == 4


def test_pieces_and_holes_are_told(tmp_path):
    apart = np.concatenate([BALL.vertices, BALL.vertices + 5])
    obj(tmp_path / "two.obj", apart, np.concatenate([BALL.faces, np.asarray(BALL.faces) + BALL.n_vertices]))
    with pytest.warns(MeshTopologyWarning, match=r"two\.obj: the surface is in 2 pieces \(.*weld=tolerance\)"):
        Mesh.read(tmp_path / "two.obj")
    meshes.cylinder(1.0, 1.0, target_edge_length=0.5).write(tmp_path / "tube.obj")
    with pytest.warns(MeshTopologyWarning, match=r"tube\.obj: it has 2 boundary loops \(holes, open ends or tears\)"):
        Mesh.read(tmp_path / "tube.obj")


# --- Polygons

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
SIDES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def test_a_textured_cube_of_quads_stays_whole(tmp_path):
    """Every corner has three texture coordinates and three normals: seams that tear a surface in other readers."""
    lines = ["mtllib cube.mtl", "o Cube"]
    lines += ["v {} {} {}".format(*v) for v in CUBE] + [f"vt {k / 24} 0.5" for k in range(24)]
    lines += [f"vn {n}" for n in ("-1 0 0", "1 0 0", "0 -1 0", "0 1 0", "0 0 -1", "0 0 1")] + [
        "g all",
        "usemtl m",
        "s 1",
    ]
    for side, corners in enumerate(SIDES):
        lines.append("f " + " ".join(f"{c + 1}/{4 * side + k + 1}/{side + 1}" for k, c in enumerate(corners)))
    path = tmp_path / "cube.obj"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(MeshFileError, match=r"6 of 6 faces are not triangles\. Mesh\.read\(path, split=True\)"):
        Mesh.read(path)
    cube = quietly(path, split=True)
    assert (cube.n_vertices, cube.n_faces, cube.is_closed) == (8, 12, True)
    report = cube.quality()
    assert np.isclose(report.volume, 1.0) and np.isclose(report.min_angle, 45.0) and report.n_components == 1


def smallest_angle(points):
    a, b, c = (np.linalg.norm(points[:, (k + 1) % 3] - points[:, (k + 2) % 3], axis=1) for k in range(3))
    return np.arccos(
        [(b**2 + c**2 - a**2) / (2 * b * c), (c**2 + a**2 - b**2) / (2 * c * a), (a**2 + b**2 - c**2) / (2 * a * b)]
    ).min()


def test_a_quad_is_cut_along_its_better_diagonal(tmp_path):
    for k in range(30):
        quad = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]) + RANDOM.uniform(-0.3, 0.3, (4, 3))
        obj(tmp_path / f"{k}.obj", quad, [[0, 1, 2, 3]])
        found = smallest_angle(corners_of(quietly(tmp_path / f"{k}.obj", split=True)))
        both = [smallest_angle(quad[np.array(cut)]) for cut in ([[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]])]
        assert np.isclose(found, max(both), rtol=1e-12)


def test_a_polygon_that_is_bent_in_keeps_its_area(tmp_path):
    """A star: a fan from any corner would leave it."""
    turn = np.linspace(0, 2 * np.pi, 10, endpoint=False)
    radius = np.where(np.arange(10) % 2, 0.35, 1.0)
    star = np.stack([radius * np.cos(turn), radius * np.sin(turn), 0 * turn], axis=1)
    obj(tmp_path / "star.obj", star, [np.arange(10)])
    mesh = quietly(tmp_path / "star.obj", split=True)
    corners = corners_of(mesh)
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] / 2
    x, y, _ = star.T
    assert mesh.n_faces == 8 and (areas > 0).all()
    assert np.isclose(areas.sum(), (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


def test_regular_polygons_are_cut_as_well_as_can_be(tmp_path):
    """No triangle on the corners of a regular n-gon has an angle below pi / n, and all that have a side on it do."""
    for n in (5, 8, 40):
        turn = np.linspace(0, 2 * np.pi, n, endpoint=False)
        obj(tmp_path / "n.obj", np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1), [np.arange(n)])
        mesh = quietly(tmp_path / "n.obj", split=True)
        assert mesh.n_faces == n - 2 and np.isclose(mesh.quality().min_angle, 180 / n)


POINTS = "0 0 0 1 0 0 1 1 0 0 1 0 2 0 0"
OFF = "5 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 0 0\n4 0 1 2 3\n3 1 4 2\n"
PLY = "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n{}end_header\n"
VTU = (
    '<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian"><UnstructuredGrid><Piece '
    'NumberOfPoints="5" NumberOfCells="2"><Points><DataArray type="Float64" NumberOfComponents="3" format="ascii">'
    f"{POINTS}</DataArray></Points><Cells>"
    '<DataArray type="Int64" Name="connectivity" format="ascii">{}</DataArray>'
    '<DataArray type="Int64" Name="offsets" format="ascii">{}</DataArray>'
    '<DataArray type="UInt8" Name="types" format="ascii">{}</DataArray></Cells>'
    '<CellData><DataArray type="Int64" Name="tag" format="ascii">7 8</DataArray></CellData>'
    "</Piece></UnstructuredGrid></VTKFile>"
)
POLYGONS = {
    "off": "OFF\n" + OFF,
    "ply": PLY.format(5, "element face 2\nproperty int tag\nproperty list uchar int vertex_indices\n")
    + "0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 0 0\n7 4 0 1 2 3\n8 3 1 4 2\n",
    "msh": "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n5\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n5 2 0 0\n$EndNodes\n"
    "$Elements\n3\n1 1 2 1 1 1 2\n2 3 2 1 1 1 2 3 4\n3 2 2 1 1 2 5 3\n$EndElements\n",
    "vtk": "# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 5 double\n"
    f"{POINTS}\nPOLYGONS 2 9\n4 0 1 2 3\n3 1 4 2\nCELL_DATA 2\nSCALARS tag int 1\nLOOKUP_TABLE default\n7 8\n",
    "vtu": VTU.format("0 1 2 3 1 4 2", "4 7", "9 5"),
    "pixel.vtu": VTU.format("0 1 3 2 1 4 2", "4 7", "8 5"),
    "strip.vtu": VTU.format("1 0 2 3 1 4 2", "4 7", "6 5"),
    "strip.vtk": "# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 5 double\n"
    f"{POINTS}\nPOLYGONS 1 4\n3 1 4 2\nTRIANGLE_STRIPS 1 5\n4 1 0 2 3\n"
    "CELL_DATA 2\nSCALARS tag int 1\nLOOKUP_TABLE default\n8 7\n",
}


@pytest.mark.parametrize("name", POLYGONS)
def test_every_format_gives_its_polygons_and_strips(tmp_path, name):
    path = tmp_path / f"m.{name}"
    path.write_text(POLYGONS[name])
    mesh = quietly(path, split=True, orient="strip" in name)
    assert mesh.n_faces == 3 and mesh.n_vertices == 5
    assert np.isclose(mesh.quality().area, 1.5)
    if "tag" in mesh.face_data:
        of_square = corners_of(mesh)[:, :, 0].max(axis=1) <= 1
        assert (np.asarray(mesh.face_data["tag"]) == np.where(of_square, 7, 8)).all()
    assert ("tag" in mesh.face_data) == (name not in ("off", "msh"))


def test_volumes_are_refused_with_what_helps(tmp_path):
    (tmp_path / "m.vtu").write_text(VTU.format("0 1 2 4 1 4 2", "4 7", "10 5"))
    with pytest.raises(MeshFileError, match=r"no flat faces.*extract_surface"):
        Mesh.read(tmp_path / "m.vtu", split=True)
    block = pyvista.ImageData(dimensions=(3, 3, 3)).cast_to_unstructured_grid()
    block.save(tmp_path / "block.vtu")
    with pytest.raises(MeshFileError, match=r"pyvista\.read\(path\)\.extract_surface\(algorithm=None\)\.save\("):
        Mesh.read(tmp_path / "block.vtu", split=True)
    pyvista.read(tmp_path / "block.vtu").extract_surface(algorithm=None).save(tmp_path / "surface.vtp")
    assert quietly(tmp_path / "surface.vtp", split=True).quality().volume == 8.0
    tetrahedron = POLYGONS["msh"].replace("2 3 2 1 1 1 2 3 4", "2 4 2 1 1 1 2 3 4")
    (tmp_path / "m.msh").write_text(tetrahedron)
    with pytest.raises(MeshFileError, match=r"kinds tetra.*gmsh -2 -order 1"):
        Mesh.read(tmp_path / "m.msh", split=True)


# --- Formats


def test_obj_lines_go_on_after_a_backslash_and_begin_with_a_mark(tmp_path):
    path = tmp_path / "m.obj"
    text = "v 0 0 \\\n 0\nv 1 0 0\nv 1 1 0\ng a b\nf 1 2 \\\n3\nv 0 1 0\ng\nf -4 \\\n -2 \\\n -1\n"
    path.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    mesh = quietly(path)
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 0 1 2\n")
    with pytest.raises(MeshFileError, match="face 0 has the corner 0, and an obj file counts from 1"):
        Mesh.read(path)


@pytest.mark.parametrize("kind", ["off", "ply", "stl"])
def test_other_texts_may_begin_with_a_byte_order_mark(tmp_path, kind):
    path = tmp_path / f"m.{kind}"
    DISC.write(path)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert np.array_equal(corners_of(quietly(path)), corners_of(DISC))


@pytest.mark.parametrize(
    ("kind", "more"), [("COFF", "255 0 0 255"), ("NOFF", "0 0 1"), ("CNOFF", "0 0 1 9 9 9 9"), ("STOFF", "0 1")]
)
def test_off_with_colours_normals_and_texture(tmp_path, kind, more):
    path = tmp_path / "m.off"
    path.write_text(
        f"{kind} # by hand\n4 2 0\n0 0 0 {more}\n1 0 0 {more}\n1 1 0 {more}\n0 1 0 {more}\n3 0 1 2 255 0 0\n3 0 2 3\n"
    )
    mesh = quietly(path)
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]


@pytest.mark.parametrize("first", ["4OFF", "nOFF\n3", "OFF BINARY"])
def test_off_of_other_kinds_is_named(tmp_path, first):
    path = tmp_path / "m.off"
    path.write_text(f"{first}\n{OFF}")
    with pytest.raises(MeshFileError, match=f"the variant {first.split(chr(10))[0]} is not supported"):
        Mesh.read(path)


@pytest.mark.parametrize("faces", ["", "element face 0\nproperty list uchar int vertex_indices\n"])
def test_a_cloud_of_points_is_named(tmp_path, faces):
    path = tmp_path / "cloud.ply"
    path.write_text(PLY.format(3, faces) + "0 0 0\n1 0 0\n0 1 0\n")
    with pytest.raises(MeshFileError, match=r"cloud\.ply.*holds 3 points and no faces.*sk\.Chamfer"):
        Mesh.read(path)
    assert sk.Chamfer(pyvista.read(path).points).target.shape == (3, 3)
    (tmp_path / "cloud.obj").write_text("v 0 0 0\nv 1 0 0\n")
    with pytest.raises(MeshFileError, match="holds 2 points and no faces"):
        Mesh.read(tmp_path / "cloud.obj")


def test_ply_strips_are_triangles(tmp_path):
    """Two strips in one list, the second with a repeated vertex that only leads on."""
    path = tmp_path / "m.ply"
    header = PLY.format(6, "element tristrips 1\nproperty list int int vertex_indices\n")
    points = "0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 2 0\n1 2 0\n"
    path.write_text(header + points + "11 0 1 2 3 -1 2 2 2 3 4 5\n")
    mesh = quietly(path)
    assert mesh.faces.tolist() == [[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5]]


# --- What is dropped, turned and scaled


def test_unused_vertices_are_dropped_on_request_with_their_data(tmp_path):
    path = tmp_path / "m.ply"
    path.write_text(
        PLY.format(5, "property int tag\nelement face 2\nproperty list uchar int vertex_indices\n")
        + "9 9 9 0\n0 0 0 1\n1 0 0 2\n1 1 0 3\n0 1 0 4\n3 1 2 3\n3 1 3 4\n"
    )
    with pytest.raises(MeshFileError, match=r"no face has vertex 0\. Mesh\.read\(path, drop_unused=True\)"):
        Mesh.read(path)
    mesh = quietly(path, drop_unused=True)
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]] and mesh.vertex_data["tag"].tolist() == [1, 2, 3, 4]


def test_faces_are_turned_alike_on_request(tmp_path):
    faces = np.array(BALL.faces)
    turned = RANDOM.permutation(len(faces))[:100]
    faces[turned] = faces[turned][:, ::-1]
    obj(tmp_path / "m.obj", BALL.vertices, faces)
    with pytest.raises(
        MeshFileError, match=r"inconsistent orientation.*Mesh\.read\(path, orient=True\) reverses the 100"
    ):
        Mesh.read(tmp_path / "m.obj")
    assert quietly(tmp_path / "m.obj", orient=True).quality().is_outward


@pytest.mark.parametrize(("unit", "metres"), [("mm", 1e-3), ("cm", 1e-2), ("m", 1.0), ("um", 1e-6), ("in", 0.0254)])
def test_units_become_metres(tmp_path, unit, metres):
    DISC.write(tmp_path / "m.vtu")
    mesh = quietly(tmp_path / "m.vtu", unit=unit)
    assert np.allclose(mesh.vertices, metres * DISC.vertices, rtol=1e-15)
    mesh.write(tmp_path / "back.vtu", unit=unit)
    assert np.allclose(quietly(tmp_path / "back.vtu").vertices, DISC.vertices, rtol=1e-15)


def test_an_unknown_unit_is_refused_before_the_file_is_opened(tmp_path):
    with pytest.raises(ValueError, match=r"Mesh\.read: unit is 'furlong'; choose one of 'mm'"):
        Mesh.read(tmp_path / "none.obj", unit="furlong")
    with pytest.raises(ValueError, match=r"Mesh\.write: unit is 'furlong'"):
        DISC.write(tmp_path / "none.obj", unit="furlong")


def test_remedies_for_a_file_work(tmp_path):
    """Whatever message offers a call of Mesh.read is answered by that call."""
    square, faces = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]], [[0, 1, 2], [0, 2, 3]]
    broken = {
        "corner": (square, [*faces, [1, 1, 2]], {"weld": True}),
        "face": (square, [*faces, [1, 2, 0]], {"weld": True}),
        "area": ([*square, square[1]], [*faces, [1, 4, 2]], {"weld": True}),
        "unused": ([*square, [5, 5, 5.0]], faces, {"drop_unused": True}),
        "turned": (square, [faces[0], faces[1][::-1]], {"orient": True}),
        "quads": (square, [[0, 1, 2, 3]], {"split": True}),
    }
    for name, (points, those, remedy) in broken.items():
        path = tmp_path / f"{name}.obj"
        obj(path, points, those)
        (option,) = remedy
        with pytest.raises(MeshFileError, match=rf"Mesh\.read\(path, {option}=True\)"):
            Mesh.read(path)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MeshTopologyWarning)
            mesh = Mesh.read(path, **remedy)
        assert mesh.n_faces == 2 and np.isclose(mesh.quality().area, 1.0), name
