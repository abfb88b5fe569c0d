"""A series of shapes for ParaView: a vtu file for each, and a pvd file that lists them with their times."""

import itertools
import os
from collections.abc import Sequence
from pathlib import Path as FilePath
from xml.sax.saxutils import quoteattr

from jaxtyping import ArrayLike

from .._equilibrium import Equilibrium
from .._fit.history import FitResult
from .._path.arc_length import Branch
from .._path.ramp import Path
from .._plot.films import Snapshots
from .._problem.problem import InverseProblem
from .._programs.whole_files import replaced


Frame = tuple[float, Equilibrium, InverseProblem | None]


def write_series(
    path: str | os.PathLike,
    frames: Path | Branch | Snapshots | FitResult | Sequence,
    *,
    problem: InverseProblem | None = None,
    times: ArrayLike | Sequence | None = None,
) -> FilePath:
    """Writes equilibria as a series for ParaView: `film.pvd`, to be opened there (or by `pyvista.get_reader`), lists
    the files `film/film_0000.vtu` and so on, each as [`shellkit.Equilibrium.write`][] writes it.

    Each file appears whole or not at all, and the list last. Files of an earlier series of the same name are replaced;
    what is left of a longer one stays in the folder, but not in the list.

    **Arguments:**

    - `path`: where to; it ends in `.pvd`. The folder of the vtu files lies beside it.
    - `frames`: a [`shellkit.Path`][] from [`shellkit.follow`][], its progress being the time; a [`shellkit.Branch`][]
        from [`shellkit.continue_path`][], counted; [`shellkit.Snapshots`][] of a fit, with the number of their step; a
        [`shellkit.FitResult`][], which has only its best design; or a list of equilibria, counted.
    - `problem`: for stress and directors; of a fit, each frame has its own.
    - `times`: one for each frame, rising, in the place of those.

    **Returns:** the path of the pvd file.

    **Raises:** `ValueError` for another ending, for no frames, for what is no series, and for times that do not rise or
    are of another number. `FileNotFoundError` for a folder that is not there.

    ??? example

        ```python
        sk.write_series("ramp.pvd", sk.follow(problem, sk.Ramp(20)), problem=problem)
        ```
    """
    path = FilePath(path)
    if path.suffix.lower() != ".pvd":
        raise ValueError(f"write_series: cannot write {path}: a series is a .pvd file, as {path.with_suffix('.pvd')}.")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"write_series: cannot write {path}: there is no folder {path.parent}; create it.")
    series = _frames(frames, problem)
    moments = [time for time, _, _ in series] if times is None else _checked_times(times, len(series))
    folder = path.with_suffix("")
    folder.mkdir(exist_ok=True)
    lines = []
    for number, (time, (_, equilibrium, own)) in enumerate(zip(moments, series, strict=True)):
        file = folder / f"{path.stem}_{number:04d}.vtu"
        equilibrium.write(file, problem=own)
        lines.append(f'    <DataSet timestep="{time!r}" part="0" file={quoteattr(f"{folder.name}/{file.name}")}/>')
    with replaced(path) as part:
        part.write_text(
            '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
            + "\n".join(lines)
            + "\n  </Collection>\n</VTKFile>\n",
            encoding="utf-8",
        )
    return path


def _frames(frames: Path | Branch | Snapshots | FitResult | Sequence, problem: InverseProblem | None) -> list[Frame]:
    if isinstance(frames, Path):
        series = [(float(t), at, problem) for t, at in zip(frames.progress, frames.equilibria, strict=True)]
    elif isinstance(frames, Branch):
        series = [(float(k), at, problem) for k, at in enumerate(frames.equilibria)]
    elif isinstance(frames, Snapshots):
        series = [_trained(float(each.step), each.problem, each.equilibrium) for each in frames.steps]
    elif isinstance(frames, FitResult):
        found = frames.equilibrium
        if found is None and isinstance(frames.problem, InverseProblem):
            found = frames.problem()
        series = [_trained(float(frames.best_step), frames.problem, found)]
    elif isinstance(frames, Sequence) and all(isinstance(each, Equilibrium) for each in frames):
        series = [(float(k), at, problem) for k, at in enumerate(frames)]
    else:
        raise ValueError(
            f"write_series: a {type(frames).__name__} is no series; give a Path, a Branch, Snapshots, a FitResult or a "
            "list of equilibria. One equilibrium is written by equilibrium.write(path)."
        )
    if not series:
        raise ValueError("write_series: there are no frames; a Path or Snapshots without any entry shows nothing.")
    return series


def _trained(step: float, problem: InverseProblem, equilibrium: Equilibrium | None) -> Frame:
    if not isinstance(problem, InverseProblem):
        raise ValueError(f"write_series: the fit trained a {type(problem).__name__}, which is no InverseProblem.")
    return step, problem.unrelaxed() if equilibrium is None else equilibrium, problem


def _checked_times(times: ArrayLike | Sequence, count: int) -> list[float]:
    moments = [float(time) for time in times]  # pyright: ignore[reportGeneralTypeIssues]  # arrays of numbers have it
    if len(moments) != count or any(b <= a for a, b in itertools.pairwise(moments)):
        raise ValueError(f"write_series: {len(moments)} times for {count} frames; give one for each, rising.")
    return moments
