"""What looks at a running fit: a progress bar on a terminal, lines of JSON on disk, curves in TensorBoard, and when to
stop. Each is opened when the fit begins, told of each step after its update, and closed when the fit ends."""

import json
import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from .._package.distribution import DISTRIBUTION
from .choices import check_count
from .history import FitStep


Told = Callable[[FitStep], str | None]  # the answer is why the fit should stop, if it should


@runtime_checkable
class Observer(Protocol):
    """What can stand among the callbacks of a fit and is more than a function."""

    def opened(self, steps: int, done: int) -> AbstractContextManager[Told]:
        """What is told of each step while it is open, for a fit of this many steps of which some are done already."""
        ...


@dataclass(frozen=True)
class Bar:
    """A bar with the loss, its terms, the speed and the time left, by rich. Nothing is shown where the output is
    neither a terminal nor a notebook."""

    @contextmanager
    def opened(self, steps: int, done: int) -> Iterator[Told]:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        console = Console(stderr=True)
        if not (console.is_terminal or console.is_jupyter):
            yield lambda info: None
            return
        columns = (MofNCompleteColumn(), TextColumn("{task.fields[losses]}"), TextColumn("{task.fields[speed]}"))
        with Progress(BarColumn(bar_width=20), *columns, TimeRemainingColumn(), console=console) as bar:
            task = bar.add_task("fit", total=steps, completed=done, losses="", speed="")

            def show(info: FitStep) -> None:
                shown = {"loss": info.loss, **info.terms} if len(info.terms) > 1 else {"loss": info.loss}
                losses = "  ".join(f"{name} {value:.3e}" for name, value in shown.items())
                rate = bar.tasks[0].speed
                speed = "" if not rate else f"{rate:.1f} steps/s" if rate >= 1 else f"{1 / rate:.1f} s/step"
                bar.update(task, completed=info.step + 1, losses=losses, speed=speed)

            yield show


@dataclass(frozen=True)
class JsonLines:
    """Among the callbacks of a fit: appends each row of the history to a file, as a line of JSON.

    What JSON cannot hold (NaN, infinity) is null. When a killed fit is resumed, the steps since its checkpoint come a
    second time.

    **Arguments:**

    - `path`: the file. Its folder is made.

    ??? example

        ```python
        sk.fit(problem, optax.adam(0.1), steps=100, callbacks=[sk.JsonLines("fit.jsonl")])
        ```
    """

    path: str | os.PathLike

    @contextmanager
    def opened(self, steps: int, done: int) -> Iterator[Told]:
        """Opens the file while a fit goes on.

        **Arguments:**

        - `steps`: how many there are to be.
        - `done`: how many there are already.
        """
        path = Path(self.path)
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a", encoding="utf-8") as file:

            def write(info: FitStep) -> None:
                row = {"step": info.step, **info.history.row(info.step)}
                line = {name: value if math.isfinite(value) else None for name, value in row.items()}
                file.write(json.dumps(line) + "\n")
                file.flush()

            yield write


@dataclass(frozen=True)
class TensorBoard:
    """Among the callbacks of a fit: writes a curve for each column of the history, by tensorboardX.

    **Arguments:**

    - `folder`: where to.

    **Raises:** `ImportError` without the extra `tensorboard`.
    """

    folder: str | os.PathLike

    def __post_init__(self):
        try:
            import tensorboardX  # noqa: F401  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            raise ImportError(f"TensorBoard needs tensorboardX: pip install '{DISTRIBUTION}[tensorboard]'") from error

    @contextmanager
    def opened(self, steps: int, done: int) -> Iterator[Told]:
        """Opens the folder while a fit goes on.

        **Arguments:**

        - `steps`: how many there are to be.
        - `done`: how many there are already.
        """
        from tensorboardX import SummaryWriter  # pyright: ignore[reportMissingImports]

        writer = SummaryWriter(str(self.folder))

        def write(info: FitStep) -> None:
            for name, value in info.history.row(info.step).items():
                writer.add_scalar(name, value, info.step)

        try:
            yield write
        finally:
            writer.close()


@dataclass(frozen=True)
class Stop:
    """Among the callbacks of a fit: ends it when the loss no longer falls, or when its time is over.

    **Arguments:**

    - `patience`: stop when the best loss of the last `patience` steps is not below the best before them by the part
        `tolerance`; [`shellkit.FitResult`][]`.stopped` is then `"plateau"`. `None`: never.
    - `tolerance`: that part.
    - `seconds`: stop after the step during which this time is over, counted for this call of `fit`; `stopped` is then
        `"seconds"`. `None`: never.

    **Raises:** `ValueError` for numbers out of range.
    """

    patience: int | None = None
    tolerance: float = 1e-4
    seconds: float | None = None

    def __post_init__(self):
        if self.patience is not None:
            check_count("Stop: patience", self.patience)
        if not self.tolerance >= 0:
            raise ValueError(f"Stop: tolerance must not be negative; got {self.tolerance}.")
        if self.seconds is not None and not self.seconds > 0:
            raise ValueError(f"Stop: seconds must be positive, or None; got {self.seconds}.")

    @contextmanager
    def opened(self, steps: int, done: int) -> Iterator[Told]:
        """Starts the clock of a fit.

        **Arguments:**

        - `steps`: how many there are to be.
        - `done`: how many there are already.
        """
        began = time.perf_counter()

        def reason(info: FitStep) -> str | None:
            if self.patience is not None and _on_plateau(info.history["loss"], self.patience, self.tolerance):
                return "plateau"
            late = self.seconds is not None and time.perf_counter() - began > self.seconds
            return "seconds" if late else None

        yield reason


def _on_plateau(loss: np.ndarray, patience: int, tolerance: float) -> bool:
    if len(loss) <= patience:
        return False
    before, lately = loss[:-patience].min(), loss[-patience:].min()
    return bool(lately >= before - tolerance * abs(before))
