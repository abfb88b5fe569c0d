"""Newton's method with a sparse direct factorisation, globalised, as an optimistix minimiser."""

from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import optimistix as optx
from jaxtyping import Array, Bool, Float, PyTree, Scalar

from ..._citation.papers import NOCEDAL_2006
from ..linear.base import AbstractSparseSolver
from ..linear.choose import default_linear_solver
from .core import Newton, NewtonState
from .corrections import Corrections
from .line_search import LineSearch
from .mixed import MixedSteps
from .objective import Function, NewtonObjective
from .saddle import SaddleEscape
from .shift import Shift


class AbstractNewton(optx.AbstractMinimiser):
    """A [`Newton`][] method as an optimistix minimiser, which is told about the function through `options`."""

    core: eqx.AbstractVar[Newton]
    """The method itself."""

    def init(
        self,
        fn: Function,
        y: Float[Array, " n"],
        args: Any,
        options: dict[str, Any],
        f_struct: PyTree,
        aux_struct: PyTree,
        tags: frozenset[object],
    ) -> NewtonState:
        return self.core.init(NewtonObjective.from_options(fn, args, options), y)

    def step(
        self,
        fn: Function,
        y: Float[Array, " n"],
        args: Any,
        options: dict[str, Any],
        state: NewtonState,
        tags: frozenset[object],
    ) -> tuple[Float[Array, " n"], NewtonState, Any]:
        state = self.core.step(NewtonObjective.from_options(fn, args, options), state)
        return state.point.y, state, None

    def terminate(
        self,
        fn: Function,
        y: Float[Array, " n"],
        args: Any,
        options: dict[str, Any],
        state: NewtonState,
        tags: frozenset[object],
    ) -> tuple[Bool[Array, ""], optx.RESULTS]:
        result = optx.RESULTS.where(state.stuck, optx.RESULTS.nonlinear_divergence, optx.RESULTS.successful)
        return state.done | state.stuck, result

    def postprocess(
        self,
        fn: Function,
        y: Float[Array, " n"],
        aux: Any,
        args: Any,
        options: dict[str, Any],
        state: NewtonState,
        tags: frozenset[object],
        result: optx.RESULTS,
    ) -> tuple[Float[Array, " n"], Any, dict[str, Any]]:
        return state.best.y, aux, {"factorisations": state.factorisations}


class SparseNewton(AbstractNewton):
    """Newton's method on the exact sparse Hessian, globalised so that it ends in a minimum or says why not.

    Each step factorises the Hessian with a shift that is raised until the inertia of the factor shows no negative
    eigenvalue and falls to zero near a minimum; takes the longest feasible step that lowers the energy; and, once
    close, adds quasi-Newton corrections with the same factor, each a fraction of the price of a step. A saddle is left
    along its softest direction, or its lowest. Where the step of a convex model has to be cut short, as the energy of a
    thin shell is a narrow curved valley, steps with the strains as unknowns of their own follow it to its end, or are
    dropped. Motions that cost nothing are held and projected out. Each of these means is a part with numbers of its
    own, and can be left out: `SparseNewton(line_search=LineSearch(armijo=0.1))`.

    It works on one flat vector and is told about the function through `options` of `optimistix.minimise`:

    - `options["hessian"]`: `y -> ` the Hessian, a sparse symmetric operator. Required, unless there is
    - `options["derivatives"]`: `y -> ` value, gradient, Hessian, and `() -> ` what makes it positive semidefinite when
        it is added, another such operator; or `None`, and a multiple of the identity is added where it must.
    - `options["value_and_gradient"]`: `y -> ` both; by default by automatic differentiation.
    - `options["feasible"]`: `(y, y_new) -> bool`, whether a step may be taken.
    - `options["motions"]`: `y -> ` motions that cost nothing, shape (n, k).
    - `options["length"]`: a typical length, such as that of an edge, against which steps are measured; 1 by default.
    - `options["apart"]`: the energy with its strains as unknowns of their own, for steps in narrow valleys: a pair of
        `y -> ` the strains, and `(y, strains, at_strains) -> ` what `options["derivatives"]` gives, at those strains or
        at those of `y`, and `step -> ` the strains to which it leads. Without it there are no such steps.
    - `options["hopeless"]`: `y -> bool`, whether no minimum can be found from there. Three steps in a row at such
        points end the search.
    - `options["structure"]`: `y -> ` a matrix of the structure of the Hessian, whose values do not count. It saves
        tracing the Hessian twice.

    [`shellkit.InverseProblem`][] provides all of these. Not for functions whose Hessian is dense, and not for single
    precision.

    ??? cite "Source"

        J. Nocedal and S. Wright, "Numerical Optimization", 2nd edition (2006), chapter 3; each part names its own.
    """

    papers: ClassVar[tuple[str, ...]] = (NOCEDAL_2006,)
    rtol: float
    atol: float
    norm: Callable[[PyTree], Scalar]
    max_steps: int = eqx.field(static=True)
    linear_solver: AbstractSparseSolver
    shift: Shift | None
    line_search: LineSearch | None
    corrections: Corrections | None
    saddle_escape: SaddleEscape | None
    mixed_steps: MixedSteps | None
    max_hopeless: int | None = eqx.field(static=True)

    def __init__(
        self,
        rtol: float = 1e-11,
        max_steps: int = 256,
        linear_solver: AbstractSparseSolver | None = None,
        *,
        shift: Shift | None = Shift(),
        line_search: LineSearch | None = LineSearch(),
        corrections: Corrections | None = Corrections(),
        saddle_escape: SaddleEscape | None = SaddleEscape(),
        mixed_steps: MixedSteps | None = MixedSteps(),
        max_hopeless: int | None = 3,
    ):
        """**Arguments:**

        - `rtol`: the relaxation ends when a full Newton step moves no unknown by more than this fraction of the typical
            length, which leaves the error far smaller still.
        - `max_steps`: the largest number of steps.
        - `linear_solver`: by default the best direct solver that is installed.
        - `shift`: what makes the Hessian positive definite. Without it one that is not, and a step that has to be cut
            short, end the search.
        - `line_search`: how far to go along a step; without it all the way.
        - `corrections`: with the factor of a step, near a minimum; `None` for none.
        - `saddle_escape`: the way off a saddle; `None` for none.
        - `mixed_steps`: in narrow valleys; `None` for none.
        - `max_hopeless`: how many steps in a row at hopeless points end the search; `None` for any number.
        """
        self.rtol = rtol
        self.atol = 0.0
        self.norm = optx.max_norm
        self.max_steps = max_steps
        self.linear_solver = default_linear_solver() if linear_solver is None else linear_solver
        self.shift = shift
        self.line_search = line_search
        self.corrections = corrections
        self.saddle_escape = saddle_escape
        self.mixed_steps = mixed_steps
        self.max_hopeless = max_hopeless

    @property
    def core(self) -> Newton:
        """The method itself, on a typed objective."""
        return Newton(
            self.rtol,
            self.linear_solver,
            self.shift,
            self.line_search,
            self.corrections,
            self.saddle_escape,
            self.mixed_steps,
            self.max_hopeless,
        )
