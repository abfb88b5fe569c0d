"""How a running fit shows itself: a progress bar on a terminal, a line of JSON a step on disk, curves in TensorBoard.
Each is a context manager that is called with every step."""

import json
import math
import os
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Protocol

from .._package.distribution import DISTRIBUTION
from .history import FitStep


class Reporter(Protocol):
    """Is entered when the fit begins, called after each step, left when the fit ends."""

    def __enter__(self) -> "Reporter": ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def __call__(self, info: FitStep) -> None: ...


class Bar:
    """A bar with the loss, its terms, the speed and the time left, by rich. Nothing is shown where the output is
    neither a terminal nor a notebook."""

    def __init__(self, steps: int, done: int):
        self._steps = steps
        self._done = done
        self._bar: Any = None
        self._task: Any = None

    def __enter__(self) -> "Bar":
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        console = Console(stderr=True)
        if console.is_terminal or console.is_jupyter:
            self._bar = Progress(
                BarColumn(bar_width=20),
                MofNCompleteColumn(),
                TextColumn("{task.fields[losses]}"),
                TextColumn("{task.fields[speed]}"),
                TimeRemainingColumn(),
                console=console,
            )
            self._task = self._bar.add_task("fit", total=self._steps, completed=self._done, losses="", speed="")
            self._bar.start()
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if self._bar is not None:
            self._bar.stop()

    def __call__(self, info: FitStep) -> None:
        if self._bar is not None:
            shown = {"loss": info.loss, **info.terms} if len(info.terms) > 1 else {"loss": info.loss}
            losses = "  ".join(f"{name} {value:.3e}" for name, value in shown.items())
            rate = self._bar.tasks[0].speed
            speed = "" if not rate else f"{rate:.1f} steps/s" if rate >= 1 else f"{1 / rate:.1f} s/step"
            self._bar.update(self._task, completed=info.step + 1, losses=losses, speed=speed)


class JsonLines:
    """A row of the history a line, appended to a file and flushed. What JSON cannot hold (NaN, infinity) is null."""

    def __init__(self, path: str | os.PathLike):
        self._path = Path(path)
        self._file: IO[str] | None = None

    def __enter__(self) -> "JsonLines":
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._file = self._path.open("a", encoding="utf-8")
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if self._file is not None:
            self._file.close()

    def __call__(self, info: FitStep) -> None:
        if self._file is not None:
            row = {"step": info.step, **info.history.row(info.step)}
            line = {name: value if math.isfinite(value) else None for name, value in row.items()}
            self._file.write(json.dumps(line) + "\n")
            self._file.flush()


class TensorBoard:
    """A curve for each column of the history, by tensorboardX."""

    def __init__(self, folder: str | os.PathLike):
        try:
            from tensorboardX import SummaryWriter  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            raise ImportError(
                f"fit(tensorboard=...) needs tensorboardX: pip install '{DISTRIBUTION}[tensorboard]'"
            ) from error
        self._writer = SummaryWriter(str(folder))

    def __enter__(self) -> "TensorBoard":
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        self._writer.close()

    def __call__(self, info: FitStep) -> None:
        for name, value in info.history.row(info.step).items():
            self._writer.add_scalar(name, value, info.step)
