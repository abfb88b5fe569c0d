"""Films: the frames of a path, of a training run or of a turning surface, as gif or mp4."""

import base64
import dataclasses
import os
import pathlib
import warnings
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import ArrayLike

from .._actuation.director_layers import Directors
from .._align.aligners import Aligner
from .._fit.history import FitResult, FitStep
from .._package.distribution import DISTRIBUTION
from .._path.ramp import Path
from .._problem.problem import InverseProblem
from .._problem.states import States
from .fields import Field
from .opengl import require_opengl
from .pictures import fields_of
from .scene import Look, color_limits, default_direction, points_of, stage
from .shapes import Drawable, Shape, Target, fit_shapes, path_shapes, shapes_of, state_shapes


_TURNING_FRAMES = 60


class Snapshots:
    """Keeps designs of a fit as it goes on, for [`shellkit.animate`][]: give it to [`shellkit.fit`][] as a callback.

    Each one kept holds its problem and its equilibrium; on fine meshes choose `every` such that they fit into memory.

    ??? example

        ```python
        film = sk.Snapshots(every=5)
        sk.fit(problem, optax.adam(0.1), steps=200, callbacks=[film])
        sk.animate(film, "training.gif")
        ```
    """

    steps: list[FitStep]
    """What was kept, in order."""

    def __init__(self, every: int = 1):
        """**Arguments:**

        - `every`: how many steps apart designs are kept, from the first one on.

        **Raises:** `ValueError` if `every` is less than one.
        """
        if every < 1:
            raise ValueError(f"Snapshots: every is {every}; give a whole number of steps, at least 1.")
        self._every = every
        self.steps = []

    def __call__(self, info: FitStep) -> None:
        if info.step % self._every == 0:
            self.steps.append(info)


@dataclasses.dataclass(frozen=True)
class Film:
    """A film that was written; at the end of a cell of a notebook it shows."""

    path: pathlib.Path
    """Where it is."""
    frames: int
    """How many different frames it has."""

    def _repr_html_(self) -> str:
        content = base64.b64encode(self.path.read_bytes()).decode()
        if self.path.suffix.lower() == ".gif":
            return f'<img src="data:image/gif;base64,{content}">'
        return f'<video src="data:video/mp4;base64,{content}" controls loop autoplay muted></video>'


def animate(
    frames: Path | Snapshots | Sequence[Drawable] | Drawable,
    save: str | os.PathLike,
    *,
    fps: float | int = 12,
    pause: float | int = 1,
    turn: float | int | None = None,
    color: str | ArrayLike | bool | None = None,
    name: str | None = None,
    unit: str | None = None,
    stress_unit: str | None = None,
    color_map: str | None = None,
    color_range: tuple[float, float] | None = None,
    directors: Directors = True,
    target: Target = None,
    aligner: Aligner | None = None,
    problem: InverseProblem | None = None,
    edges: bool | None = None,
    camera: ArrayLike | Sequence | None = None,
    size: tuple[int, int] = (420, 440),
) -> Film:
    """Draws a film: one camera and one range of colours for all frames.

    **Arguments:**

    - `frames`: a [`shellkit.Path`][] from [`shellkit.follow`][], whose equilibria are the frames;
        [`shellkit.Snapshots`][] of a fit, each at rest with its directors, and relaxed under the wireframe of its
        target; a list of things that [`shellkit.plot`][] draws, one per frame; or one such thing, which is turned.
    - `save`: a file to write: gif, or mp4 (needs the extra `video`).
    - `fps`: frames a second. A gif counts hundredths of a second.
    - `pause`: for how many seconds the last frame stays.
    - `turn`: by how many degrees the camera goes around the z axis during the film; by default 360 for one thing, else
        none.
    - `color`, `name`, `unit`, `stress_unit`, `color_map`, `color_range`, `directors`, `target`, `aligner`, `problem`,
        `edges`: as for [`shellkit.plot`][].
    - `camera`: the direction in which the camera stands at the beginning, seen from the surface, three numbers.
    - `size`: width and height of a panel in pixels.

    **Returns:** a [`shellkit.Film`][] with the path and the number of frames.

    **Raises:** `ValueError` as for [`shellkit.plot`][], and for a film without frames, frames of different numbers of
    panels, or a type of file that is not known. `ImportError` for mp4 without the extra.

    ??? example

        ```python
        sk.animate(sk.follow(problem, sk.Ramp(20)), "ramp.gif", problem=problem, color="stress")
        ```
    """
    path = _checked(save, fps, pause)
    scenes = _scenes(frames, directors, target, aligner, problem)
    if not scenes:
        raise ValueError("animate: there are no frames; a Path or Snapshots without any entry shows nothing.")
    counts = {len(scene) for scene in scenes}
    if len(counts) > 1:
        raise ValueError(f"animate: the frames have different numbers of panels, {sorted(counts)}; give equal ones.")
    overlay = not isinstance(frames, FitResult)
    shapes = [shape for scene in scenes for shape in scene]
    fields = fields_of(shapes, color, name)
    shown = [field for field in fields if field is not None]
    points = points_of(shapes, overlay)
    toward = default_direction(points) if camera is None else np.asarray(camera, dtype=float)
    if toward.shape != (3,):
        raise ValueError(f"animate: camera is {camera}; give a direction, three numbers.")
    single = len(scenes) == 1
    angle = (360.0 if single else 0.0) if turn is None else turn
    if single and angle:
        scenes, fields = scenes * _TURNING_FRAMES, fields * _TURNING_FRAMES
    look = Look(
        edges=edges,
        color_map=color_map,
        color_range=color_limits(shown) if color_range is None else color_range,
        unit=unit,
        stress_unit=stress_unit,
        size=size,
        overlay=overlay,
    )
    require_opengl()
    turns = np.linspace(0, angle, len(scenes), endpoint=angle % 360 != 0)  # the last frame is not the first again
    pictures = _pictures(scenes, fields, look, toward, turns, _around(points) if angle else points)
    if path.suffix.lower() == ".gif":
        _write_gif(path, list(pictures), fps, 0.0 if single else pause)
    else:
        _write_mp4(path, pictures, fps, 0.0 if single else pause)
    return Film(path, len(scenes))


def _checked(save: str | os.PathLike, fps: float | int, pause: float | int) -> pathlib.Path:
    path = pathlib.Path(save)
    if path.suffix.lower() not in (".gif", ".mp4"):
        raise ValueError(f"animate: cannot write {path}: the type {path.suffix!r} is neither .gif nor .mp4.")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"animate: cannot write {path}: there is no folder {path.parent}.")
    if not (0 < fps <= 100 and pause >= 0):
        raise ValueError(
            f"animate: fps is {fps}, pause is {pause}; give 0 < fps <= 100, and a pause that is not negative."
        )
    if path.suffix.lower() == ".mp4":
        try:
            import imageio_ffmpeg  # noqa: F401 (what writes the file)
        except ImportError as error:
            raise ImportError(
                f"animate: writing {path} needs ffmpeg: pip install '{DISTRIBUTION}[video]'; gif needs nothing. "
                f"({error})"
            ) from error
    return path


def _scenes(
    frames: Path | Snapshots | Sequence[Drawable] | Drawable,
    directors: Directors,
    target: Target,
    aligner: Aligner | None,
    problem: InverseProblem | None,
) -> list[list[Shape]]:
    """The panels of every frame."""
    if isinstance(frames, Path):
        return [[shape] for shape in path_shapes(frames, directors, target, aligner, problem)]
    if isinstance(frames, Snapshots):
        return [_snapshot(each, directors, target, aligner) for each in frames.steps]
    things = list(frames) if isinstance(frames, Sequence) else [frames]
    return [shapes_of(each, directors, target, aligner, problem) for each in things]


def _snapshot(step: FitStep, directors: Directors, target: Target, aligner: Aligner | None) -> list[Shape]:
    if isinstance(step.problem, States):
        shapes = state_shapes(step.problem, step.equilibrium, directors, target, aligner)
        return [dataclasses.replace(shape, title=f"{shape.title}, step {step.step}") for shape in shapes]
    if not isinstance(step.problem, InverseProblem):
        raise ValueError(f"animate: the fit trained a {type(step.problem).__name__}, which is no InverseProblem.")
    equilibrium = step.problem.unrelaxed() if step.equilibrium is None else step.equilibrium
    rest, relaxed = fit_shapes(step.problem, equilibrium, directors, target, aligner)
    named = dataclasses.replace(rest, title=f"step {step.step}")
    # Where nothing is relaxed, the design at rest is all there is to see.
    return [named] if step.equilibrium is None else [named, dataclasses.replace(relaxed, title=f"loss {step.loss:.3g}")]


def _about_z(degrees: float | int) -> np.ndarray:
    cos, sin = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def _around(points: np.ndarray) -> np.ndarray:
    """Where points come to as they turn about the middle."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return np.concatenate([middle + (points - middle) @ _about_z(a).T for a in range(0, 360, 15)])


def _pictures(
    scenes: list[list[Shape]],
    fields: list[Field | None],
    look: Look,
    toward: np.ndarray,
    turns: np.ndarray,
    seen: np.ndarray,
) -> Iterator[np.ndarray]:
    panels = len(scenes[0])
    middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    for k, (scene, turn) in enumerate(zip(scenes, turns.tolist(), strict=True)):
        # What is to be in view goes with the camera, which so keeps its distance.
        view = dataclasses.replace(look, camera=_about_z(turn) @ toward)
        framed = middle + (seen - middle) @ _about_z(turn).T
        plotter = stage(scene, fields[k * panels : (k + 1) * panels], view, off_screen=True, seen=framed)
        try:
            yield np.asarray(plotter.screenshot(None, return_img=True))
        finally:
            plotter.close()


def _write_gif(path: pathlib.Path, pictures: list[np.ndarray], fps: float | int, pause: float | int) -> None:
    from PIL import Image

    # One palette for all frames, or colours flicker.
    chosen = [pictures[k] for k in np.unique(np.linspace(0, len(pictures) - 1, 5).round().astype(int))]
    palette = Image.fromarray(np.concatenate(chosen)).quantize(255, method=Image.Quantize.MEDIANCUT)
    # The background stays white.
    colors = np.array(palette.getpalette() or ()).reshape(-1, 3)
    palette.putpalette(np.where((colors > 245).all(axis=1, keepdims=True), 255, colors).ravel().tolist())
    images = [Image.fromarray(each).quantize(palette=palette, dither=Image.Dither.NONE) for each in pictures]
    usual = max(10, 10 * round(100 / fps))
    durations = [usual] * (len(images) - 1) + [usual + round(1000 * pause)]
    images[0].save(path, save_all=True, append_images=images[1:], duration=durations, loop=0, optimize=True)


def _write_mp4(path: pathlib.Path, pictures: Iterator[np.ndarray], fps: float | int, pause: float | int) -> None:
    import imageio_ffmpeg

    first = next(pictures)
    height, width = (side - side % 2 for side in first.shape[:2])  # the format knows even sizes only
    writer = imageio_ffmpeg.write_frames(
        str(path),
        (width, height),
        fps=fps,  # pyright: ignore[reportArgumentType]
        codec="libx264",
        quality=8,
        macro_block_size=2,
        output_params=["-an"],
    )
    with warnings.catch_warnings():
        # JAX warns of processes that fork and go on with it; this one becomes another program.
        warnings.filterwarnings("ignore", message=r"os\.fork")
        writer.send(None)
    last = first
    try:
        writer.send(np.ascontiguousarray(first[:height, :width]))
        for last in pictures:
            writer.send(np.ascontiguousarray(last[:height, :width]))
        for _ in range(round(pause * fps)):
            writer.send(np.ascontiguousarray(last[:height, :width]))
    finally:
        writer.close()
