"""What a fit may be told besides its problem and its method: where relaxations start, and which designs are refused."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class WarmStart:
    """Relaxations of a fit that start from the equilibrium of the last design, not from rest.

    That saves relaxation steps, and can mislead: a shell with several equilibria follows the one it is on, which is not
    always the one that it would relax to from rest. Hence the design is relaxed from rest as well every so many steps;
    `warm_gap` in the history records by how much the losses differ, and the fit warns when they part. The best design
    is checked at the end.

    **Arguments:**

    - `guess`: where to start: the `"last"` equilibrium, or its first-order prediction for the new design
        (`"predicted"`: one more linear solve a step).
    - `check_every`: how many steps apart the equilibrium is checked against a relaxation from rest.

    **Raises:** `ValueError` for another guess, or a number below 1.
    """

    guess: Literal["last", "predicted"] = "last"
    check_every: int = 20

    def __post_init__(self):
        if self.guess not in ("last", "predicted"):
            raise ValueError(f"WarmStart: guess must be 'last' or 'predicted'; got {self.guess!r}.")
        check_count("WarmStart: check_every", self.check_every)


@dataclass(frozen=True)
class Refuse:
    """Which designs a fit refuses, besides those whose loss or gradient is not finite.

    **Arguments:**

    - `unconverged`: those whose relaxation did not converge. `False` where a minimiser stops short of its tolerance as
        a rule; the gradients are only about right there.
    - `rise`: those whose loss is above that of the step before by more than this part of it, as where the shell snaps:
        with a warm start a shorter step stays on its branch. At most four in a row: the one after these is taken. Nor
        is a warm start that fails tried again from rest before that. `None`: never. A method for least squares goes
        downhill unless this lets it climb, over the edge of a snap, say; it takes no other design, however many are
        refused.
    - `most`: how many in a row before the fit stops.

    **Raises:** `ValueError` for numbers below zero.
    """

    unconverged: bool = True
    rise: float | None = None
    most: int = 8

    def __post_init__(self):
        if self.rise is not None and not self.rise >= 0:
            raise ValueError(f"Refuse: rise must not be negative, or be None; got {self.rise}.")
        check_count("Refuse: most", self.most, least=0)


def check_count(name: str, count: int, least: int = 1) -> None:
    """Raises a `ValueError` for what is no whole number, or too small."""
    if count != int(count) or count < least:
        raise ValueError(f"{name} must be a whole number, at least {least}; got {count}.")
