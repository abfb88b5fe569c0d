"""Newton's method where nothing goes wrong: what `SparseNewton` does as long as the Hessian is positive definite and
its steps need not be cut short. A program of this alone takes half as long to compile."""

from collections.abc import Callable

from jaxtyping import PyTree, Scalar

from .core import Newton
from .newton import AbstractNewton, SparseNewton


class PlainNewton(AbstractNewton):
    """The steps of a [`shellkit.SparseNewton`][] without its means against saddles, indefinite Hessians and narrow
    valleys. Where it would need one of them it stops as stuck, at the point where that solver has to go on; up to there
    both take the same steps.

    It is told about the function as that one is.
    """

    rtol: float
    atol: float
    norm: Callable[[PyTree], Scalar]
    core: Newton

    def __init__(self, like: SparseNewton):
        """**Arguments:**

        - `like`: the solver whose steps it takes.
        """
        self.rtol, self.atol, self.norm = like.rtol, like.atol, like.norm
        self.core = like.core.plain()
