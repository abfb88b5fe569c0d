"""What a fit leaves behind: the columns it recorded, what a callback is told at each step, and the result."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np


Scalar = bool | int | float


class History(Mapping[str, np.ndarray]):
    """The record of a fit: a dictionary of NumPy arrays, one entry of each a step.

    Row $k$ describes the design *before* update $k$; row 0 is the start. Each row is a design that was accepted, so
    nothing here is NaN unless said. The columns of [`shellkit.fit`][]:

    - `loss`: the total loss, weights included.
    - one column for each loss term, by its name: its value *without* its weight.
    - `gradient_norm`: the Euclidean norm of the derivative of the loss in all the variables of the optimiser.
    - `solver_steps`: steps of the relaxation.
    - `relaxation_gradient_norm`: what the relaxation left of the gradient of the energy, in units of force.
    - `converged`, `stable`: what the relaxation said of itself.
    - `refused`: how many designs were tried and refused before this one was accepted; 0 as a rule.
    - `update_scale`: the part of the optimiser's update that led here: 1 unless designs were refused lately.
    - with a least-squares solver, in place of `update_scale`: `control`, the damping, the part of the Gauss–Newton step
        or the radius of the dogleg with which the design was reached (NaN at the start), and `products`, how many pairs
        of products with the Jacobian and its transpose were made there; with a method of your own, what it records.
    - `seconds`: wall time since the fit began, compilation included and earlier runs of a resumed fit counted.
    - `warm_gap` (with warm starts only): the loss less the loss when relaxed from rest; NaN where that was not checked.

    The columns of the relaxation are absent where no loss term looks at the shape.

    ??? example

        ```python
        result.history["loss"].min()
        plt.semilogy(result.history["seconds"], result.history["loss"])
        ```
    """

    def __init__(self, columns: Mapping[str, list[Scalar]] | None = None):
        """**Arguments:**

        - `columns`: by name, all of one length; by default there are none yet.
        """
        self._columns: dict[str, list[Scalar]] = {name: list(column) for name, column in (columns or {}).items()}

    @property
    def steps(self) -> int:
        """The number of rows."""
        return len(next(iter(self._columns.values()), []))

    def row(self, step: int) -> dict[str, Scalar]:
        """One row, as a dictionary of Python scalars.

        **Arguments:**

        - `step`: its number, from 0.
        """
        return {name: column[step] for name, column in self._columns.items()}

    def append(self, row: Mapping[str, Scalar]) -> None:
        """Adds a row. The first one names the columns.

        **Arguments:**

        - `row`: a number for each column.

        **Raises:** `ValueError` for a row with other columns.
        """
        if not self._columns:
            self._columns = {name: [] for name in row}
        if row.keys() != self._columns.keys():
            missing, extra = self._columns.keys() - row.keys(), row.keys() - self._columns.keys()
            raise ValueError(
                f"a row of the history must have its columns; missing: {sorted(missing)}, new: {sorted(extra)}. "
                "The loss terms of a problem must keep their names during a fit."
            )
        for name, value in row.items():
            self._columns[name].append(value)

    def truncate(self, steps: int) -> None:
        """Forgets the last rows.

        **Arguments:**

        - `steps`: how many are kept.
        """
        for column in self._columns.values():
            del column[steps:]

    def lists(self) -> dict[str, list[Scalar]]:
        """The columns as lists, for JSON."""
        return self._columns

    def __getitem__(self, name: str) -> np.ndarray:
        return np.asarray(self._columns[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    def __repr__(self) -> str:
        return f"History({self.steps} steps of {', '.join(self._columns)})"


@dataclass(frozen=True)
class FitStep:
    """What a callback of [`shellkit.fit`][] is told: the step just evaluated, before its update.

    **Attributes:**

    - `step`: its number, from 0; also its row in `history`.
    - `steps`: how many there are to be.
    - `problem`: the problem with the design of this step.
    - `equilibrium`: its equilibrium (`None` where no loss term looks at the shape).
    - `loss`: the total loss.
    - `terms`: the value of each loss term by name, without its weight.
    - `history`: every row so far, this one included. Not to be changed.
    """

    step: int
    steps: int
    problem: Any
    equilibrium: Any
    loss: float
    terms: dict[str, float]
    history: History


@dataclass(frozen=True)
class FitResult:
    """What [`shellkit.fit`][] returns.

    **Attributes:**

    - `problem`: the problem with the best design seen.
    - `best_loss`: its loss.
    - `best_step`: its row in the history; `history.steps` if it is the one after the last update, which is evaluated
        but has no row of its own.
    - `equilibrium`: its equilibrium, if the fit was warm-started: from rest, `problem()` may find another. Else `None`.
    - `last_problem`: the problem with the design of the last row.
    - `history`: the record of all steps, see [`shellkit.History`][].
    - `stopped`: why the fit ended: `"steps"` (all done), `"converged"` (by the tolerances of a least-squares solver),
        `"plateau"`, `"callback"`, `"seconds"`, `"refused"` (too many designs refused in a row) or `"interrupted"`
        (Ctrl-C). `"running"` in a checkpoint of a fit that was killed.
    - `state`: the optimiser's state after the last update; `None` from [`shellkit.load_checkpoint`][].
    """

    problem: Any
    best_loss: float
    best_step: int
    equilibrium: Any
    last_problem: Any
    history: History
    stopped: str
    state: Any

    def __repr__(self) -> str:
        return (
            f"FitResult(best_loss={self.best_loss:.6g} at step {self.best_step} of {self.history.steps}, "
            f"stopped={self.stopped!r})"
        )
