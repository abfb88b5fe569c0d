"""What films hold: their frames, the time each is shown, one camera and one range of colours."""

import sys
import warnings

import jax.numpy as jnp
import numpy as np
import pytest
from PIL import Image

import shellkit as sk


SMALL = {"size": (120, 120)}


@pytest.fixture(scope="module")
def sheet():
    return sk.meshes.rectangle(2.0, 1.0, cells=(4, 2))


@pytest.fixture(scope="module")
def path(sheet, equilibrium_of):
    """A sheet that rises step by step."""
    shapes = [sheet.vertices.at[:, 2].set(0.4 * k * sheet.vertices[:, 0] ** 2) for k in (1, 2, 3)]
    progress = jnp.array([1 / 3, 2 / 3, 1.0])
    return sk.Path(progress, tuple(equilibrium_of(sheet, shape) for shape in shapes), ())


def frames_of(path):
    with Image.open(path) as film:
        frames, times = [], []
        for k in range(film.n_frames):
            film.seek(k)
            frames.append(np.asarray(film.convert("RGB"), dtype=int))
            times.append(film.info["duration"])
        return frames, times, film.info.get("loop")


def filled(frame):
    """The rows and columns with something on them."""
    drawn = (frame < 245).any(axis=2)
    return np.flatnonzero(drawn.any(axis=1)), np.flatnonzero(drawn.any(axis=0))


def test_a_path_is_a_film(path, tmp_path):
    film = sk.animate(path, tmp_path / "a.gif", fps=20, pause=0.5, **SMALL)
    frames, times, loop = frames_of(tmp_path / "a.gif")
    assert film.frames == len(frames) == 3 and loop == 0
    assert times == [50, 50, 550]
    assert all(frame.shape == (120, 120, 3) for frame in frames)
    assert all((frame[:, 0] == 255).all() for frame in frames)
    # The camera stays while the sheet rises out of its plane.
    tops = [filled(frame[20:90])[0].min() for frame in frames]
    assert tops[0] > tops[1] > tops[2]
    assert film._repr_html_().startswith('<img src="data:image/gif;base64,R0lGOD')


def test_one_thing_turns_once_around(tmp_path, monkeypatch):
    monkeypatch.setattr("shellkit._plot.films._TURNING_FRAMES", 4)
    bar = sk.meshes.rectangle(4.0, 0.5, cells=(8, 1))
    bar = bar.with_vertices(bar.vertices + jnp.array([7.0, 0.0, 0.0]))  # turned about its own middle, wherever it lies
    film = sk.animate(bar, tmp_path / "a.gif", camera=(0.0, -1.0, 0.5), **SMALL)
    frames, times, _ = frames_of(tmp_path / "a.gif")
    assert film.frames == len(frames) == 4 and len(set(times)) == 1
    widths = [np.ptp(filled(frame)[1]) for frame in frames]
    assert widths[0] == pytest.approx(widths[2], abs=2) and widths[1] == pytest.approx(widths[3], abs=2)
    assert widths[0] > 2 * widths[1]
    for frame in frames:
        left, right = filled(frame)[1][[0, -1]]
        assert left + right == pytest.approx(119, abs=4)


def test_snapshots_of_a_fit(problem, moved, result, tmp_path):
    film = sk.Snapshots(every=2)
    for step in range(5):
        seen = moved if step < 4 else moved.mesh
        assert film(sk.FitStep(step, 5, problem, moved, 1.0 / (1 + step), {}, result.history)) is None, seen
    assert [each.step for each in film.steps] == [0, 2, 4]
    from shellkit._plot.films import _scenes

    scenes = _scenes(film, True, None, None, None)
    assert [[shape.title for shape in scene] for scene in scenes] == [
        ["step 0", "loss 1"],
        ["step 2", "loss 0.333"],
        ["step 4", "loss 0.2"],
    ]
    rest, relaxed = scenes[0]
    assert len(rest.layers) == len(relaxed.layers) == 2
    np.testing.assert_allclose(relaxed.target.points, 1.5 * moved.mesh.vertices, rtol=1e-12)
    unchanged = sk.animate(film, tmp_path / "a.gif", **SMALL)
    frames, _, _ = frames_of(tmp_path / "a.gif")
    assert unchanged.frames == len(frames) == 3  # that differ in their titles
    assert frames[0].shape == (120, 240, 3)


def test_mp4(path, tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    film = sk.animate(path, tmp_path / "a.mp4", fps=10, pause=0.2, size=(121, 121))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=r"os\.fork")  # of JAX, at the programs that the test starts
        frames, seconds = ffmpeg.count_frames_and_secs(str(tmp_path / "a.mp4"))
        reader = ffmpeg.read_frames(str(tmp_path / "a.mp4"))
        assert next(reader)["size"] == (120, 120)
        picture = np.frombuffer(next(reader), np.uint8).reshape(120, 120, 3)
        reader.close()
    assert frames == 3 + 2 and seconds == pytest.approx(0.5, abs=0.05)
    assert (picture > 240).all(axis=2).mean() > 0.3 and (picture < 200).any(axis=2).mean() > 0.05
    assert film._repr_html_().startswith("<video")


def test_what_is_wrong_is_said(path, sheet, moved, result, tmp_path, monkeypatch):
    with pytest.raises(ValueError, match=r"'\.avi' is neither \.gif nor \.mp4"):
        sk.animate(path, tmp_path / "a.avi")
    with pytest.raises(ValueError, match="no frames"):
        sk.animate(sk.Snapshots(), tmp_path / "a.gif")
    with pytest.raises(ValueError, match=r"different numbers of panels, \[1, 3\]"):
        sk.animate([moved, result], tmp_path / "a.gif")
    with pytest.raises(ValueError, match="every is 0"):
        sk.Snapshots(every=0)
    with pytest.raises(FileNotFoundError, match="no folder"):
        sk.animate(path, tmp_path / "missing" / "a.gif")
    with pytest.raises(ValueError, match="fps is 0"):
        sk.animate(path, tmp_path / "a.gif", fps=0.0)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ImportError, match=r"pip install 'shellkit-jax\[video\]'"):
        sk.animate(path, tmp_path / "a.mp4")
