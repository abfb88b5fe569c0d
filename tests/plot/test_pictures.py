"""What a scene holds, what is refused, and that something is drawn."""

import importlib
import json
import re
import shutil
import subprocess

import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk


SMALL = {"size": (160, 160)}


@pytest.fixture
def draw():
    """`sk.plot` in small, closed after the test."""
    drawn = []

    def plot(*args, **kwargs):
        drawn.append(sk.plot(*args, **SMALL, **kwargs))
        return drawn[-1]

    yield plot
    for plotter in drawn:
        plotter.close()


def actors(plotter):
    return [dict(renderer.actors) for renderer in plotter.renderers]


def drawn_mesh(plotter, name, panel=0):
    return plotter.renderers[panel].actors[name].mapper.dataset


def test_a_mesh_is_one_plain_surface(draw, sphere):
    plotter = draw(sphere)
    surface = drawn_mesh(plotter, "surface 0")
    np.testing.assert_allclose(surface.points, sphere.vertices, rtol=1e-6)
    np.testing.assert_array_equal(surface.regular_faces, sphere.faces)
    assert list(actors(plotter)[0]) == ["surface 0"]


def test_an_equilibrium_is_coloured_by_its_displacement(draw, moved):
    plotter = draw(moved, directors=False)
    expected = np.linalg.norm(moved.vertices - moved.mesh.vertices, axis=1)
    np.testing.assert_allclose(drawn_mesh(plotter, "surface 0").point_data["displacement"], expected, rtol=1e-12)
    assert any("heading" in name for name in actors(plotter)[0])


def test_a_path_is_four_of_its_equilibria(draw, sphere, equilibrium_of):
    shapes = tuple(equilibrium_of(sphere, (1 + 0.1 * k) * sphere.vertices) for k in range(1, 8))
    plotter = draw(sk.Path(jnp.linspace(0, 1, 8)[1:], shapes, ()))
    assert plotter.shape == (1, 4)
    sizes = [np.linalg.norm(drawn_mesh(plotter, f"surface {k}", k).points, axis=1).mean() for k in range(4)]
    np.testing.assert_allclose(sizes, [1.1, 1.3, 1.5, 1.7], rtol=1e-6)
    assert [plotter.renderers[k].actors[f"title {k}"].input for k in (0, 3)] == ["14%", "100%"]


def test_an_equilibrium_has_the_directors_and_stress_of_its_problem(draw, problem, moved):
    plotter = draw(moved, problem=problem, color="stress", stress_unit="MPa")
    assert {"directors 0 0", "directors 0 1"} < set(actors(plotter)[0])
    assert plotter.renderers[0].actors["heading of surface 0"].input == "stress (MPa)"
    assert len(drawn_mesh(plotter, "surface 0").cell_data["stress"]) == moved.mesh.n_faces


def test_each_layer_has_its_own_lines(draw, problem, sphere):
    plotter = draw(problem)
    colors = [plotter.renderers[0].actors[f"directors 0 {layer}"].prop.color.hex_rgb for layer in (0, 1)]
    assert len(set(colors)) == 2
    assert "directors 0 0" not in actors(draw(problem, directors=False))[0]
    one_layer = actors(draw(sphere, directors=jnp.zeros(sphere.n_faces)))[0]
    assert "directors 0 0" in one_layer and "directors 0 1" not in one_layer


def test_a_fit_shows_rest_result_and_target_side_by_side(draw, result, moved):
    plotter = draw(result)
    assert plotter.shape == (1, 3)
    rest, relaxed, target = (drawn_mesh(plotter, f"surface {k}", k) for k in range(3))
    np.testing.assert_allclose(rest.points, moved.mesh.vertices, rtol=1e-6)
    np.testing.assert_allclose(relaxed.points, moved.vertices, rtol=1e-6)  # the loss aligns nothing
    np.testing.assert_allclose(target.points, 1.5 * moved.mesh.vertices, rtol=1e-6)
    error = np.linalg.norm(moved.vertices - 1.5 * moved.mesh.vertices, axis=1)
    np.testing.assert_allclose(relaxed.point_data["error"], error, rtol=1e-6)
    assert [sorted(n for n in a if n.startswith("directors")) for a in actors(plotter)] == [
        ["directors 0 0", "directors 0 1"],
        ["directors 1 0", "directors 1 1"],
        [],
    ]
    assert len({id(renderer.camera) for renderer in plotter.renderers}) == 1


def test_panels_share_camera_and_colours(draw, sphere):
    larger = sphere.with_vertices(2 * sphere.vertices)
    plotter = draw([sphere, larger], color="mean curvature")
    ranges = [plotter.renderers[k].actors[f"surface {k}"].mapper.scalar_range for k in range(2)]
    assert ranges[0] == ranges[1]
    assert plotter.renderers[0].camera is plotter.renderers[1].camera


@pytest.mark.parametrize("direction", [None, (0.0, 0.0, 1.0), (1.0, -2.0, 0.3)])
def test_nothing_is_cut_off(draw, direction):
    mesh = sk.meshes.rectangle(4.0, 1.0, cells=(8, 2))
    plotter = draw([mesh, mesh.with_vertices(3 * mesh.vertices + 5.0)], camera=direction)
    matrix = plotter.camera.GetCompositeProjectionTransformMatrix(1.0, -1, 1)
    matrix = np.array([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])
    points = np.concatenate([drawn_mesh(plotter, f"surface {k}", k).points for k in range(2)])
    seen = np.c_[points, np.ones(len(points))] @ matrix.T
    x, y = (seen[:, :2] / seen[:, 3:]).T
    # A margin at the sides, room for a title above and for a legend and a colour bar below; no nearer and no further.
    filled = max(np.abs(x).max() / 0.94, y.max() / 0.8, -y.min() / 0.56)
    assert filled == pytest.approx(1, abs=1e-4)


def test_a_target_is_drawn_over_a_surface(draw, sphere, moved):
    plotter = draw(moved, target=sphere)
    wireframe = plotter.renderers[0].actors["target 0"]
    assert wireframe.prop.style == "Wireframe"
    assert "error" in drawn_mesh(plotter, "surface 0").point_data


def test_values_of_either_sign_are_centred_on_zero(draw, sphere):
    plotter = draw(sphere, color=np.linspace(-1.0, 3.0, sphere.n_faces), name="stress")
    assert plotter.renderers[0].actors["surface 0"].mapper.scalar_range == (-3.0, 3.0)
    assert "stress" in drawn_mesh(plotter, "surface 0").cell_data
    given = draw(sphere, color=np.linspace(-1.0, 3.0, sphere.n_vertices), color_range=(0.0, 2.0))
    assert given.renderers[0].actors["surface 0"].mapper.scalar_range == (0.0, 2.0)


def test_a_picture_is_written_and_not_blank(draw, problem, tmp_path):
    from PIL import Image

    plotter = draw(problem, title="a sphere", save=tmp_path / "sphere.png")
    picture = np.asarray(Image.open(tmp_path / "sphere.png").convert("RGB"), dtype=int)
    assert picture.shape == (160, 160, 3)
    assert (picture[0] == 255).all() and (picture[:, 0] == 255).all()  # white, with a margin
    assert (picture < 250).any(axis=2).mean() > 0.2
    orange = (picture[..., 0] - picture[..., 2]) > 100
    blue = (picture[..., 2] - picture[..., 0]) > 60
    assert orange.sum() > 30 and blue.sum() > 30
    assert plotter._repr_png_().startswith(b"\x89PNG")


def test_other_files_are_written(draw, sphere, tmp_path):
    for name in ("scene.svg", "scene.gltf"):
        draw(sphere, color="mean curvature", save=tmp_path / name)
        assert (tmp_path / name).stat().st_size > 1000


def test_gltf_holds_the_surface_and_its_lines(draw, sphere, tmp_path):
    draw(sphere, color="mean curvature", directors=jnp.zeros(sphere.n_faces), save=tmp_path / "scene.gltf")
    scene = json.loads((tmp_path / "scene.gltf").read_text())
    assert scene["asset"]["version"] == "2.0"
    counts = [scene["accessors"][each["primitives"][0]["attributes"]["POSITION"]]["count"] for each in scene["meshes"]]
    assert sphere.n_vertices in counts and max(counts) > 8 * 2 * sphere.n_faces  # tubes of eight sides
    assert all(buffer["uri"].startswith("data:") for buffer in scene["buffers"])


def test_a_page_needs_nothing_from_elsewhere(draw, sphere, tmp_path):
    pytest.importorskip("trame_pyvista")
    draw([sphere, sphere], color="mean curvature", title=["one & two", ""], unit="mm", save=tmp_path / "scene.html")
    page = (tmp_path / "scene.html").read_text(encoding="utf-8")
    assert "<title>scene</title>" in page
    assert ">one &amp; two</div>" in page and ">mean curvature (1/mm)</div>" in page
    # What a browser would fetch: in attributes, styles and scripts. Notices of copyright hold addresses too.
    asked_for = re.findall(r"""(?:src|href|url|fetch|import|from)\s*[=(]?\s*["'`]?\s*(?:https?:)?//[\w.]+""", page)
    assert not asked_for and "favicon-" not in page.replace("data:,favicon-", "")
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)[1]
    assert "http" not in policy and policy.startswith("default-src data: blob:")


@pytest.mark.slow
def test_a_browser_draws_a_page_without_a_network(sphere, tmp_path):
    from PIL import Image

    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no browser")
    pytest.importorskip("trame_pyvista")
    sk.plot(sphere, directors=jnp.zeros(sphere.n_faces), save=tmp_path / "scene.html", **SMALL).close()
    flags = "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    flags += "--disable-component-update --disable-sync --enable-unsafe-swiftshader --virtual-time-budget=15000"
    places = [f"--user-data-dir={tmp_path / 'profile'}", f"--log-net-log={tmp_path / 'net.json'}"]
    places += [f"--screenshot={tmp_path / 'page.png'}", "--window-size=400,400", (tmp_path / "scene.html").as_uri()]
    command = [browser, *flags.split(), *places]
    done = subprocess.run(command, capture_output=True, timeout=120)
    assert done.returncode == 0
    asked = set(re.findall(r'"url":"(https?://[^"/]*)', (tmp_path / "net.json").read_text()))
    assert all("google" in each for each in asked), asked  # the browser's own
    picture = np.asarray(Image.open(tmp_path / "page.png").convert("RGB"), dtype=int)
    orange = (picture[..., 0] - picture[..., 2]) > 100
    assert (picture < 250).any(axis=2).mean() > 0.1 and orange.sum() > 100


def test_what_is_wrong_is_said(sphere, moved, tmp_path):
    with pytest.raises(ValueError, match=r"'heat' here; there are: 'mean curvature', 'gauss curvature'\.$"):
        sk.plot(sphere, color="heat")
    with pytest.raises(ValueError, match=r"'displacement'.*'strain'"):
        sk.plot(moved, color="heat")
    with pytest.raises(ValueError, match=r"color has shape \(7,\).*\(42,\).*\(80,\)"):
        sk.plot(sphere, color=np.zeros(7))
    with pytest.raises(ValueError, match=r"layer of shape \(42,\).*\(80,\)"):
        sk.plot(sphere, directors=np.zeros(42))
    with pytest.raises(ValueError, match=r"target has shape \(5, 3\).*42"):
        sk.plot(sphere, target=np.zeros((5, 3)))
    with pytest.raises(ValueError, match=r"\.doc"):
        sk.plot(sphere, save=tmp_path / "picture.doc")
    with pytest.raises(FileNotFoundError, match="missing"):
        sk.plot(sphere, save=tmp_path / "missing" / "picture.png")
    with pytest.raises(ValueError, match="2 titles for 1 panels"):
        sk.plot(sphere, title=["a", "b"])
    with pytest.raises(ValueError, match="empty list"):
        sk.plot([])


def test_missing_opengl_is_said_before_vtk_fails(monkeypatch):
    from shellkit._plot import opengl

    # By its full name: trame puts another module of the name into the package.
    vtkRenderingCore = importlib.import_module("vtkmodules.vtkRenderingCore")

    class vtkOSOpenGLRenderWindow:
        """What VTK falls back to where it finds nothing."""

    monkeypatch.setattr(vtkRenderingCore, "vtkRenderWindow", vtkOSOpenGLRenderWindow)
    monkeypatch.setattr(opengl.ctypes.util, "find_library", lambda name: None)
    with pytest.raises(RuntimeError, match="apt-get install libegl1 libgl1-mesa-dri"):
        opengl.require_opengl.__wrapped__()


def test_showing_needs_a_screen(monkeypatch, sphere):
    monkeypatch.setattr("shellkit._plot.pictures.has_display", lambda: False)
    with pytest.raises(ValueError, match="screen"):
        sk.plot(sphere, show=True)
