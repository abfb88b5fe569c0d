"""Each generator against the exact shape: where its points lie, area and volume at second order, triangles without
slivers, edges as long as asked for, nothing twice, and no direction preferred."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from shellkit import meshes


PI = np.pi
# name: (mesh of a target edge length, exact area, exact volume or None, Euler characteristic)
SHAPES = {
    "sphere": (lambda h: meshes.sphere(h, radius=2.0), 16 * PI, 32 / 3 * PI, 2),
    "disc": (lambda h: meshes.disc(2.0, h), 4 * PI, None, 1),
    "annulus": (lambda h: meshes.annulus(1.0, 2.0, h), 3 * PI, None, 0),
    "slit annulus": (lambda h: meshes.annulus(1.0, 2.0, h, slit=True), 3 * PI, None, 1),
    "cap": (lambda h: meshes.spherical_cap(2.0, PI / 3, h), 4 * PI, None, 1),
    "cap with a hole": (lambda h: meshes.spherical_cap(2.0, PI / 2, h, hole=PI / 6), 4 * np.sqrt(3) * PI, None, 0),
    "cylinder": (lambda h: meshes.cylinder(1.0, 3.0, target_edge_length=h), 6 * PI, None, 0),
    "torus": (lambda h: meshes.torus(2.0, 1.0, h), 8 * PI**2, 4 * PI**2, 0),
    "rectangle": (lambda h: meshes.rectangle(3.0, 2.0, target_edge_length=h), 6.0, None, 1),
    "alternating": (lambda h: meshes.rectangle(3.0, 2.0, target_edge_length=h, diagonals="alternating"), 6.0, None, 1),
    "jittered": (lambda h: meshes.rectangle(3.0, 2.0, target_edge_length=h, diagonals="jittered"), 6.0, None, 1),
}
FLAT = ("rectangle", "alternating", "jittered")


def face_normals(mesh):
    a, b, c = np.moveaxis(np.asarray(mesh.vertices)[np.asarray(mesh.faces)], 1, 0)
    return np.cross(b - a, c - a), (a + b + c) / 3


@pytest.mark.parametrize("name", SHAPES)
def test_topology_and_shape_of_triangles(name):
    make, _, _, euler = SHAPES[name]
    for h in (0.35, 0.2, 0.12):
        report = make(h).quality()
        assert report.euler_characteristic == euler and report.n_components == 1
        assert abs(report.edge_lengths.mean() / h - 1) < 0.1
        if name == "jittered":
            assert report.min_angle > 10 and report.max_angle < 140
        else:
            assert report.min_angle > 30 and report.max_angle < 110


@pytest.mark.parametrize("name", SHAPES)
def test_area_and_volume_converge_at_second_order(name):
    make, area, volume, _ = SHAPES[name]
    reports = [make(h).quality() for h in (0.4, 0.1)]
    if name in FLAT:
        assert np.allclose([r.area for r in reports], area, rtol=1e-13)
        return
    sizes = [r.edge_lengths.mean() for r in reports]
    for exact, found in ((area, [r.area for r in reports]), (volume, [r.volume for r in reports])):
        if exact is not None:
            errors = np.abs(np.array(found) / exact - 1)
            assert errors[1] < 3e-3
            # The polygons that bound a ring err alike inside and outside, and all but cancel.
            assert "annulus" in name or np.log(errors[0] / errors[1]) / np.log(sizes[0] / sizes[1]) > 1.85


@pytest.mark.parametrize("slit", [False, True])
def test_a_ring_lies_between_regular_polygons(slit):
    mesh = meshes.annulus(1.0, 2.0, 0.3, slit=slit)
    edges = np.asarray(mesh.edges)[np.asarray(mesh.boundary_edges)]
    distance = np.linalg.norm(np.asarray(mesh.vertices)[edges], axis=2)
    n_inner, n_outer = (np.isclose(distance, r).all(1).sum() for r in (1, 2))
    polygon = lambda n, r: n * r**2 * np.sin(2 * PI / n) / 2
    assert np.isclose(mesh.quality().area, polygon(n_outer, 2) - polygon(n_inner, 1), rtol=1e-13)


@pytest.mark.parametrize("name", SHAPES)
def test_no_point_twice_and_equal_calls_give_equal_meshes(name):
    make = SHAPES[name][0]
    mesh, again = make(0.3), make(0.3)
    assert np.array_equal(mesh.vertices, again.vertices) and np.array_equal(mesh.faces, again.faces)
    if name == "slit annulus":
        lips = np.asarray(mesh.vertices)[np.asarray(mesh.boundary_vertices)]
        lips = lips[(lips[:, 1] == 0) | (np.abs(lips[:, 1]) < 1e-12)]
        lips = lips[lips[:, 0] > 0]
        pairs = KDTree(np.asarray(mesh.vertices)).query_pairs(1e-9)
        assert len(lips) == 2 * len(pairs) > 4  # each point of the slit, and no other, belongs to both lips
    else:
        distance, _ = KDTree(np.asarray(mesh.vertices)).query(np.asarray(mesh.vertices), k=2)
        assert distance[:, 1].min() > 0.3 * 0.3


def test_points_lie_on_their_surface_and_normals_point_outward():
    for name, (make, *_) in SHAPES.items():
        mesh = make(0.25)
        x, y, z = np.asarray(mesh.vertices).T
        axis = np.hypot(x, y)
        normal, middle = face_normals(mesh)
        if name in ("sphere", "cap", "cap with a hole"):
            assert np.allclose(np.sqrt(axis**2 + z**2), 2, rtol=1e-14)
            outward = middle
        elif name == "cylinder":
            assert np.allclose(axis, 1, rtol=1e-14) and z.min() == -1.5 and z.max() == 1.5
            outward = middle * [1, 1, 0]
        elif name == "torus":
            assert np.allclose(np.hypot(axis - 2, z), 1, rtol=1e-13)
            outward = middle - 2 * middle * [1, 1, 0] / np.linalg.norm(middle[:, :2], axis=1, keepdims=True)
        else:
            assert not z.any()
            outward = np.broadcast_to([0, 0, 1.0], middle.shape)
        assert ((normal * outward).sum(1) > 0).all(), name


def test_rims_are_where_they_were_asked_for():
    for mesh, radii in (
        (meshes.disc(2.0, 0.3), [2]),
        (meshes.annulus(1.0, 2.0, 0.3), [1, 2]),
        (meshes.spherical_cap(2.0, PI / 2, 0.3, hole=PI / 6), [1, 2]),
    ):
        rims = [np.asarray(mesh.vertices)[loop] for loop in mesh.boundary_loops()]
        assert np.allclose(sorted(np.hypot(r[:, 0], r[:, 1]).mean() for r in rims), radii, rtol=1e-14)
        for rim in rims:
            side = np.linalg.norm(rim - np.roll(rim, 1, axis=0), axis=1)
            assert np.ptp(side) < 1e-12


def second_moment(mesh):
    """Of the surface, exact for its triangles, about its centroid; and that centroid."""
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    area = mesh.quality().areas
    centroid = (area[:, None] * corners.mean(1)).sum(0) / area.sum()
    nodes = np.concatenate([corners, 3 * corners.mean(1, keepdims=True)], axis=1)
    return np.einsum("f,fki,fkj->ij", area / 12, nodes, nodes), centroid


@pytest.mark.parametrize("name", ["sphere", "disc", "annulus", "torus"])
def test_no_direction_is_preferred(name):
    moment, centroid = second_moment(SHAPES[name][0](0.2))
    tolerance = {"torus": 2e-3}.get(name, 1e-12)  # only the torus has no symmetry beyond that of its shape
    assert np.abs(centroid).max() < tolerance
    plane = moment[:2, :2]
    assert np.abs(plane - plane.trace() / 2 * np.eye(2)).max() < tolerance * plane.trace()
    if name == "sphere":
        assert np.abs(moment - moment.trace() / 3 * np.eye(3)).max() < 1e-12 * moment.trace()


def test_edges_of_a_disc_run_in_all_directions():
    mesh = meshes.disc(1.0, 0.04)
    d = np.diff(np.asarray(mesh.vertices)[np.asarray(mesh.edges)], axis=1)[:, 0, :2]
    turned = np.exp(1j * np.arctan2(d[:, 1], d[:, 0])[:, None] * np.array([2, 4, 6]))
    assert np.abs(turned.mean(0)).max() < 0.1


@pytest.mark.parametrize("subdivisions, count", [(0, 12), (1, 42), (2, 162), (3, 642)])
def test_icosphere(subdivisions, count):
    mesh = meshes.icosphere(subdivisions, radius=3.0)
    vertices = np.asarray(mesh.vertices)
    assert mesh.n_vertices == count and mesh.n_faces == 20 * 4**subdivisions
    assert np.allclose(np.linalg.norm(vertices, axis=1), 3, rtol=1e-15)
    for pole in ([0, 0, 3], [0, 0, -3]):
        assert (vertices == pole).all(1).sum() == (subdivisions > 0)
    valence = np.bincount(np.asarray(mesh.edges).ravel())
    assert (valence == 5).sum() == 12 and np.isin(valence, (5, 6)).all()
    moment, centroid = second_moment(mesh)
    assert np.abs(centroid).max() < 1e-14 and np.allclose(moment, moment[0, 0] * np.eye(3), atol=1e-12)
    report = mesh.quality()
    assert report.is_outward and report.min_angle > 54 and report.max_angle < 72


def cycles(faces):
    """Faces as a set, each from its smallest corner on: neither their order nor where they begin counts."""
    return {tuple(np.roll(face, -np.argmin(face))) for face in np.asarray(faces).tolist()}


def test_subdivision_halves_the_coarser_sphere_and_moves_it_out():
    coarse, fine = meshes.icosphere(1), meshes.icosphere(2)
    middle = coarse.refine().vertices
    assert cycles(fine.faces) == cycles(coarse.refine().faces)
    assert np.allclose(fine.vertices, middle / np.linalg.norm(middle, axis=1, keepdims=True), rtol=0, atol=1e-15)


@pytest.mark.parametrize("h", [0.8, 0.55, 0.41, 0.3, 0.17])
def test_sphere_has_twelve_vertices_of_valence_five(h):
    mesh = meshes.sphere(h)
    valence = np.bincount(np.asarray(mesh.edges).ravel())
    assert (valence == 5).sum() == 12 and np.isin(valence, (5, 6)).all()
    assert np.allclose(np.abs(np.asarray(mesh.vertices)[[0, -1]]), [0, 0, 1], atol=1e-12)


@pytest.mark.parametrize("diagonals", ["right", "alternating", "jittered"])
def test_rectangle_spans_its_cells(diagonals):
    mesh = meshes.rectangle(length=10.0, width=1.0, cells=(40, 4), diagonals=diagonals)
    x, y, z = np.asarray(mesh.vertices).T
    assert mesh.n_vertices == 41 * 5 and mesh.n_faces == 2 * 40 * 4
    assert (x.min(), x.max(), y.min(), y.max()) == (0, 10, 0, 1) and not z.any()
    assert (x == 0).sum() == (x == 10).sum() == 5 and (y == 0).sum() == (y == 1).sum() == 41
    for corner in ((0, 0), (10, 0), (0, 1), (10, 1)):
        assert ((x == corner[0]) & (y == corner[1])).sum() == 1
    assert np.isclose(mesh.quality().area, 10, rtol=1e-13)
    if diagonals != "jittered":
        grid = np.stack(np.meshgrid(np.arange(41) / 4, np.arange(5) / 4), axis=-1).reshape(-1, 2)
        assert np.allclose(np.stack([x, y], axis=1), grid, atol=1e-14)
        ends = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
        assert np.array_equal(ends[:, 0, 1], ends[:, 1, 1])  # first edges along x


def test_diagonals_run_as_named():
    def slopes(diagonals):
        mesh = meshes.rectangle(6.0, 4.0, cells=(6, 4), diagonals=diagonals)
        d = np.diff(np.asarray(mesh.vertices)[np.asarray(mesh.edges)], axis=1)[:, 0]
        return np.sign(d[:, 0] * d[:, 1])[d[:, 0] * d[:, 1] != 0]

    assert (slopes("right") == 1).all() and len(slopes("right")) == 24
    assert slopes("alternating").sum() == 0
    assert abs(slopes("jittered").sum()) > 0


def test_jitter_moves_points_by_up_to_three_tenths_of_a_cell_and_depends_on_the_seed():
    points = [np.asarray(meshes.rectangle(1.0, 1.0, (20, 20), diagonals="jittered", seed=s).vertices) for s in (0, 1)]
    grid = np.asarray(meshes.rectangle(1.0, 1.0, (20, 20)).vertices)
    moved = np.abs(points[0] - grid).max(0) * 20
    assert (moved[:2] <= 0.3 + 1e-12).all() and (moved[:2] > 0.29).all()
    assert np.abs(points[0] - points[1]).max() > 0.01


def test_a_jittered_mesh_is_delaunay():
    mesh = meshes.rectangle(1.0, 1.0, (12, 12), diagonals="jittered")
    corners = np.asarray(mesh.quality().angles)
    inner = np.asarray(mesh.edge_faces)[:, 1] >= 0
    faces, at = np.asarray(mesh.edge_faces)[inner], np.asarray(mesh.edge_corners)[inner]
    assert (corners[faces, at].sum(1) <= 180 + 1e-9).all()  # angles opposite an inner edge


def test_cylinder_rows_are_staggered():
    mesh = meshes.cylinder(1.0, 2.0, cells=(8, 4))
    x, y, z = np.asarray(mesh.vertices).reshape(5, 8, 3).transpose(2, 0, 1)
    turn = np.angle((x + 1j * y) / np.exp(2j * PI * np.arange(8) / 8))
    assert np.allclose(turn, PI / 8 * (np.arange(5) % 2)[:, None])
    assert np.allclose(z, np.linspace(-1, 1, 5)[:, None])
    assert len(np.unique(mesh.quality().edge_lengths.round(12))) == 2  # isosceles


def test_torus_of_cells():
    report = meshes.torus(1.0, 0.4, cells=(40, 18)).quality()
    assert (report.n_vertices, report.genus, report.is_outward) == (720, 1, True)


@pytest.mark.parametrize(
    "words, make",
    [
        ("radius is -1", lambda: meshes.icosphere(1, radius=-1.0)),
        ("subdivisions is -1", lambda: meshes.icosphere(-1)),
        ("target_edge_length is 0", lambda: meshes.sphere(0.0)),
        ("too large", lambda: meshes.disc(1.0, 2.0)),
        ("at most 0.1257", lambda: meshes.torus(1.0, 0.1, 0.2)),
        ("inner < outer", lambda: meshes.annulus(2.0, 1.0, 0.1)),
        ("hole < angle", lambda: meshes.spherical_cap(1.0, 0.5, 0.1, hole=0.6)),
        ("minor < major", lambda: meshes.torus(1.0, 1.0, 0.1)),
        ("must be even", lambda: meshes.torus(1.0, 0.4, cells=(8, 5))),
        ("at least (3, 1)", lambda: meshes.cylinder(1.0, 1.0, cells=(2, 1))),
        ("not both", lambda: meshes.rectangle(1.0, 1.0)),
        ("not both", lambda: meshes.rectangle(1.0, 1.0, cells=(2, 2), target_edge_length=0.1)),
    ],
)
def test_sizes_that_make_no_mesh_are_refused(words, make):
    with pytest.raises(ValueError) as error:
        make()
    assert words in str(error.value)


def test_an_unknown_kind_of_diagonals_is_refused():
    with pytest.raises((ValueError, TypeError), match="'left'"):  # a TypeError where types are checked at each call
        meshes.rectangle(1.0, 1.0, cells=(2, 2), diagonals="left")
