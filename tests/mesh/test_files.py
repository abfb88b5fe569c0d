"""Every format gives back what it can keep, bit for bit, and says what it cannot; broken files are refused by name."""

import os
import subprocess
import sys
import warnings

import jax.numpy as jnp
import numpy as np
import pytest

from shellkit import meshes
from shellkit._mesh import Mesh, MeshDataWarning, MeshFileError


RANDOM = np.random.default_rng(0)
PLAIN = meshes.spherical_cap(1.0, 1.0, 0.4)
PLAIN = PLAIN.with_vertices(PLAIN.vertices * (1 + 1e-3 * RANDOM.normal(size=PLAIN.vertices.shape)))
V, F = PLAIN.n_vertices, PLAIN.n_faces
FORMATS = ("obj", "off", "ply", "stl", "vtk", "vtp", "vtu", "msh")


def exactly(a, b):
    a, b = np.asarray(a), np.asarray(b)
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


@pytest.mark.parametrize("extension", FORMATS)
def test_positions_faces_and_first_corners_come_back(tmp_path, extension):
    path = tmp_path / f"cap.{extension}"
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # no data, nothing to lose
        PLAIN.write(path)
    mesh = Mesh.read(str(path))
    if extension == "stl":
        corners = lambda m: m.vertices[m.faces]
        assert exactly(corners(mesh), corners(PLAIN)) and mesh.n_vertices == V
    else:
        assert exactly(mesh.vertices, PLAIN.vertices) and exactly(mesh.faces, PLAIN.faces)
    assert not mesh.vertex_data and not {name for name in mesh.face_data if not name.startswith("gmsh:")}
    assert os.listdir(tmp_path) == [path.name]


KINDS = {
    "number": RANDOM.normal(size=F),
    "single": RANDOM.normal(size=F).astype(np.float32),
    "vector": RANDOM.normal(size=(F, 3)),
    "quaternion": RANDOM.normal(size=(F, 4)),
    "metric": RANDOM.normal(size=(F, 2, 2)),
    "column": RANDOM.normal(size=(F, 1)),
    "label": RANDOM.integers(-5, 5, F),
    "large": RANDOM.integers(2**60, 2**61, F),
    "small": RANDOM.integers(0, 200, F).astype(np.uint8),
    "flag": RANDOM.random(F) > 0.5,
    "complex": RANDOM.normal(size=F) + 1j,
    "two words, θ": RANDOM.normal(size=F),
    "not a number": np.where(RANDOM.random(F) > 0.5, np.nan, -0.0),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("extension", ["vtk", "vtp", "vtu"])
def test_vtk_formats_keep_data_of_every_kind(tmp_path, extension, kind):
    path = tmp_path / f"cap.{extension}"
    on_vertices = np.resize(KINDS[kind], (V, *KINDS[kind].shape[1:]))
    PLAIN.write(path, vertex_data={kind: on_vertices}, face_data={kind: KINDS[kind]})
    mesh = Mesh.read(path)
    assert exactly(mesh.vertex_data[kind], on_vertices) and exactly(mesh.face_data[kind], KINDS[kind])
    assert mesh.vertex_data.keys() == mesh.face_data.keys() == {kind}


# What comes back from a ply file or a msh file, by its type; None where it cannot be kept.
STORED = {
    "ply": {
        **{name: KINDS[name].dtype for name in ("number", "single", "vector", "quaternion", "column", "small")},
        **{"label": np.int32, "flag": np.uint8, "not a number": None, "metric": None, "large": None},
        **{"complex": None, "two words, θ": None},
    },
    "msh": {
        **dict.fromkeys(
            ("number", "single", "vector", "label", "small", "flag", "two words, θ", "not a number"), float
        ),
        **dict.fromkeys(("quaternion", "metric", "column", "large", "complex"), None),
    },
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("extension", STORED)
def test_ply_and_msh_keep_values_or_say_so(tmp_path, extension, kind):
    path = tmp_path / f"cap.{extension}"
    kept = STORED[extension][kind]
    on_vertices = np.resize(KINDS[kind], (V, *KINDS[kind].shape[1:]))
    write = lambda: PLAIN.write(path, vertex_data={kind: on_vertices}, face_data={kind: KINDS[kind]})
    if kept is None:
        with pytest.warns(MeshDataWarning, match=f"vertex data '{kind}'.*face data '{kind}'.*vtu"):
            write()
        assert kind not in Mesh.read(path).face_data
    else:
        write()
        mesh = Mesh.read(path)
        assert exactly(mesh.face_data[kind], KINDS[kind].astype(kept))
        assert exactly(mesh.vertex_data[kind], on_vertices.astype(kept))


@pytest.mark.parametrize("extension", ["obj", "off", "stl"])
def test_formats_without_data_say_what_they_drop(tmp_path, extension):
    mesh = Mesh(PLAIN.vertices, PLAIN.faces, {"heat": np.zeros(V)}, {"angle": np.zeros(F)})
    with pytest.warns(MeshDataWarning) as caught:
        mesh.write(tmp_path / f"cap.{extension}", face_data={"more": np.ones(F)})
    text = str(caught[0].message)
    assert all(word in text for word in ("'heat'", "'angle'", "'more'", f".{extension}", "vtu"))


def test_given_data_stand_in_for_the_meshs_own(tmp_path):
    mesh = Mesh(PLAIN.vertices, PLAIN.faces, face_data={"a": np.zeros(F), "b": np.ones(F)})
    mesh.write(tmp_path / "m.vtu", face_data={"a": jnp.full(F, 2.0)})
    back = Mesh.read(tmp_path / "m.vtu").face_data
    assert (back["a"] == 2).all() and (back["b"] == 1).all()
    with pytest.raises(ValueError, match=r"face_data\['a'\]"):
        mesh.write(tmp_path / "other.vtu", face_data={"a": np.zeros(F + 1)})
    assert os.listdir(tmp_path) == ["m.vtu"]


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "m.obj"
    PLAIN.write(path)
    before = path.read_bytes()

    def broken(path, content):
        path.write_text("half")
        raise OSError("disk full")

    monkeypatch.setattr("shellkit._mesh.formats.obj.write", broken)
    with pytest.raises(OSError, match="disk full"):
        meshes.icosphere(0).write(path)
    assert path.read_bytes() == before and os.listdir(tmp_path) == ["m.obj"]


def test_missing_and_unknown_files_are_named(tmp_path):
    for path in ("no/such/file.obj", "no/such/file.vtu"):
        with pytest.raises(MeshFileError, match=path) as error:
            Mesh.read(path)
        assert isinstance(error.value, ValueError) and isinstance(error.value, FileNotFoundError)
    with pytest.raises(MeshFileError, match="there is no folder no/such"):
        PLAIN.write("no/such/file.obj")
    for action in (Mesh.read, PLAIN.write):
        with pytest.raises(MeshFileError, match=r"a\.step: .*obj, off, ply"):
            action(tmp_path / "a.step")


QUADS = {
    "obj": "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nf 1 2 3 4\nf 2 5 3\n",
    "off": "OFF\n5 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 0 0\n4 0 1 2 3\n3 1 4 2\n",
    "ply": "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 0 0\n4 0 1 2 3\n3 1 4 2\n",
    "msh": "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n5\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n5 2 0 0\n$EndNodes\n"
    "$Elements\n3\n1 1 2 1 1 1 2\n2 3 2 1 1 1 2 3 4\n3 2 2 1 1 2 5 3\n$EndElements\n",
    "vtk": "# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 5 double\n0 0 0 1 0 0 1 1 0 0 1 0 2 0 0\n"
    "POLYGONS 2 9\n4 0 1 2 3\n3 1 4 2\n",
}


@pytest.mark.parametrize("extension", QUADS)
def test_faces_that_are_no_triangles_are_counted(tmp_path, extension):
    path = tmp_path / f"quads.{extension}"
    path.write_text(QUADS[extension])
    with pytest.raises(MeshFileError, match=f"quads.{extension}.*1 of 2 faces are not triangles"):
        Mesh.read(path)


@pytest.mark.parametrize("extension", FORMATS)
@pytest.mark.parametrize("content", [b"", b"nonsense\n1 2 3\n", bytes(range(256))])
def test_files_of_something_else_are_refused(tmp_path, extension, content, capfd):
    path = tmp_path / f"broken.{extension}"
    path.write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pyvista's own, of the empty grid it makes of such a file
        with pytest.raises(MeshFileError, match=f"broken.{extension}"):
            Mesh.read(path)


@pytest.mark.parametrize("extension", FORMATS)
def test_files_cut_short_are_refused(tmp_path, extension):
    whole, part = tmp_path / f"whole.{extension}", tmp_path / f"part.{extension}"
    PLAIN.write(whole)
    part.write_bytes(whole.read_bytes()[: whole.stat().st_size // 3])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(MeshFileError, match=f"part.{extension}"):
            Mesh.read(part)


def test_a_mesh_that_is_no_surface_is_refused_with_its_path(tmp_path):
    path = tmp_path / "m.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 5 5 5\nf 1 2 3\n")
    with pytest.raises(MeshFileError, match=r"m\.obj: unused vertex: no face has vertex 3"):
        Mesh.read(path)


def test_obj_as_others_write_it(tmp_path):
    path = tmp_path / "m.obj"
    path.write_text(
        "# by hand\nmtllib x.mtl\no thing\nv 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 1 1 0\nvt 0 0\nvn 0 0 1\n"
        "g part\ns off\nf 1/1/1 2//1 3/1\nv 0 1 0\nf -4 -2 -1\n"
    )
    mesh = Mesh.read(path)
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]] and mesh.vertices[2].tolist() == [1, 1, 0]


@pytest.mark.parametrize("order", ["<", ">"])
def test_ply_in_either_byte_order_with_lists_among_the_data(tmp_path, order):
    name = {"<": "little", ">": "big"}[order]
    header = (
        f"ply\nformat binary_{name}_endian 1.0\ncomment by hand\n"
        "element vertex 4\nproperty double x\nproperty double y\nproperty double z\nproperty short tag\n"
        "element face 2\nproperty uchar red\n"
        "property list uchar uint vertex_index\nproperty list uchar float texcoord\nelement edge 1\nproperty int a\n"
        "end_header\n"
    )
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]
    vertex = np.zeros(4, [("x", f"{order}f8", 3), ("tag", f"{order}i2")])
    vertex["x"], vertex["tag"] = points, [-1, 2, 300, 4]
    body = vertex.tobytes()
    for red, corners, texture in ((7, (0, 1, 2), (0.5,) * 6), (255, (0, 2, 3), ())):
        body += bytes([red, 3]) + np.array(corners, f"{order}u4").tobytes()
        body += bytes([len(texture)]) + np.array(texture, f"{order}f4").tobytes()
    path = tmp_path / "m.ply"
    path.write_bytes(header.encode() + body + np.array([1], f"{order}i4").tobytes())
    mesh = Mesh.read(path)
    assert mesh.vertices.tolist() == points and mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert mesh.vertex_data["tag"].tolist() == [-1, 2, 300, 4] and mesh.vertex_data["tag"].dtype == np.int16
    assert mesh.face_data["red"].tolist() == [7, 255] and "texcoord" not in mesh.face_data


def test_binary_stl_is_merged_where_corners_are_equal(tmp_path):
    corners = np.asarray(PLAIN.vertices, np.float32)[np.asarray(PLAIN.faces)]
    records = np.zeros(F, [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    records["corners"] = corners
    path = tmp_path / "m.stl"
    path.write_bytes(b"solid, and binary all the same".ljust(80) + np.uint32(F).tobytes() + records.tobytes())
    mesh = Mesh.read(path)
    assert mesh.n_vertices == V and exactly(mesh.vertices[mesh.faces], corners.astype(float))
    assert len(mesh.boundary_loops()) == 1


def test_stl_takes_both_zeros_for_one_point(tmp_path):
    facet = "facet normal 0 0 1\nouter loop\nvertex {}\nvertex {}\nvertex {}\nendloop\nendfacet\n"
    path = tmp_path / "m.stl"
    path.write_text(
        "solid\n" + facet.format("0 0 0", "1 0 0", "1 1 0") + facet.format("-0.0 0 0", "1 1 -0", "0 1 0") + "endsolid\n"
    )
    assert Mesh.read(path).faces.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_vtk_text_with_lines_among_the_triangles(tmp_path):
    path = tmp_path / "m.vtk"
    path.write_text(
        "# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 4 double\n0 0 0 1 0 0 1 1 0 0 1 0\n"
        "LINES 1 3\n2 0 1\nPOLYGONS 2 8\n3 0 1 2\n3 0 2 3\n"
        "CELL_DATA 3\nSCALARS tag int 1\nLOOKUP_TABLE default\n10 11 12\n"
    )
    mesh = Mesh.read(path)
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]] and mesh.face_data["tag"].tolist() == [11, 12]


def test_other_programs_read_our_files(tmp_path):
    import meshio
    import pyvista

    angle = np.linspace(0, 1, F)
    for extension in ("ply", "vtk", "vtp", "vtu", "obj", "stl"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MeshDataWarning)
            PLAIN.write(tmp_path / f"m.{extension}", face_data={"angle": angle})
        grid = pyvista.read(tmp_path / f"m.{extension}")
        assert grid.n_cells == F and np.allclose(np.ptp(grid.points, axis=0), np.ptp(PLAIN.vertices, axis=0))
    for extension in ("vtu", "msh"):
        PLAIN.write(tmp_path / f"n.{extension}", face_data={"angle": angle})
        theirs = meshio.read(tmp_path / f"n.{extension}")
        assert np.array_equal(theirs.cells_dict["triangle"], PLAIN.faces)
        assert np.array_equal(theirs.cell_data["angle"][0], angle)


def test_reading_an_obj_imports_no_heavy_library(tmp_path):
    path = tmp_path / "m.obj"
    PLAIN.write(path)
    code = (
        "import sys, jax; jax.config.update('jax_enable_x64', True)\n"
        "from shellkit._mesh import Mesh\n"
        f"Mesh.read({str(path)!r})\n"
        "print({'pyvista', 'vtk', 'vtkmodules', 'meshio'} & set(sys.modules))"
    )
    root = os.path.dirname(os.path.dirname(os.path.dirname(__file__)))
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
