"""Newton's method on a sparse Hessian, made of parts; it knows no optimistix minimiser and no shells.

A step expands the energy, factorises a model, proposes a direction, goes down along it, and judges where that led: each
is a method here, and what passes between them is a record of `points` or `model`."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int, Scalar

from ..._programs.tracing import with_parts
from ..null_space import gauge_coordinates, orthonormal, project_out
from .corrections import Corrections
from .descent import descend
from .line_search import LineSearch
from .mixed import MixedState, MixedSteps
from .model import Factorised, KeptFactor, QuadraticModel, kept, positive_definite
from .objective import Expansion, NewtonObjective, StrainsAhead
from .points import Point, Reached, Step, choose
from .saddle import SaddleEscape
from .shift import Shift


class NewtonState(eqx.Module):
    """State of a [`Newton`][] method between two steps. What belongs to an absent part is `None`."""

    point: Point
    factor: KeptFactor
    factorisations: Int[Array, ""]
    shift: Scalar | None
    escaping: Bool[Array, ""] | None
    """A saddle was reached: the next step leads off it."""
    mixed: MixedState | None
    hopeless: Int[Array, ""] | None
    """For how many steps it has been."""
    done: Bool[Array, ""]
    stuck: Bool[Array, ""]

    @property
    def best(self) -> Point:
        """Where the search is; in the midst of mixed steps, where they began."""
        mixed = self.mixed
        return self.point if mixed is None else choose(mixed.on, mixed.origin, self.point)

    @property
    def result(self) -> optx.RESULTS:
        """How the search has ended, if no more steps follow."""
        unsettled = optx.RESULTS.where(
            self.stuck, optx.RESULTS.nonlinear_divergence, optx.RESULTS.nonlinear_max_steps_reached
        )
        return optx.RESULTS.where(self.done, optx.RESULTS.successful, unsettled)


class _Verdict(eqx.Module):
    """What is made of a step: whether the minimum is found, or cannot be, and the shift to go on with."""

    settled: Bool[Array, ""]
    stuck: Bool[Array, ""]
    shift: Scalar | None
    hopeless: Int[Array, ""] | None


class Newton(eqx.Module):
    """The method behind [`shellkit.SparseNewton`][], on a typed objective. A part that is `None` is not traced.

    **Arguments:**

    - `rtol`: the search ends when a full Newton step is smaller than this fraction of the typical length.
    - `linear_solver`: of matrices like the Hessian: sparse ones or bordered ones.
    - `shift`: without it a Hessian that is not positive definite, and a step that has to be cut short, end the search
        as stuck, where they began.
    - `line_search`, `corrections`, `saddle_escape`, `mixed_steps`: see there.
    - `max_hopeless`: how many steps in a row at hopeless points end the search; `None` for any number.
    """

    rtol: float
    linear_solver: Any
    shift: Shift | None
    line_search: LineSearch | None
    corrections: Corrections | None
    saddle_escape: SaddleEscape | None
    mixed_steps: MixedSteps | None
    max_hopeless: int | None = eqx.field(static=True)

    def plain(self) -> "Newton":
        """This without its means against saddles, indefinite Hessians and narrow valleys. Up to where it needs one of
        them, and is stuck, both take the same steps."""
        return with_parts(self, shift=None, saddle_escape=None, mixed_steps=None, max_hopeless=None)

    def minimise(
        self, objective: NewtonObjective, y: Float[Array, " n"], max_steps: int
    ) -> tuple[NewtonState, Int[Array, ""]]:
        """The state at the end, and the number of steps.

        **Arguments:**

        - `objective`: what is minimised.
        - `y`: where to start.
        - `max_steps`: the largest number of steps.
        """

        def goes_on(carry: tuple[NewtonState, Int[Array, ""]]) -> Bool[Array, ""]:
            state, count = carry
            return ~(state.done | state.stuck) & (count < max_steps)

        def step(carry: tuple[NewtonState, Int[Array, ""]]) -> tuple[NewtonState, Int[Array, ""]]:
            state, count = carry
            return self.step(objective, state), count + 1

        return jax.lax.while_loop(goes_on, step, (self.init(objective, y), jnp.zeros((), jnp.int32)))

    def init(self, objective: NewtonObjective, y: Float[Array, " n"]) -> NewtonState:
        """The state before the first step, which evaluates where it stands, as every step does.

        **Arguments:**

        - `objective`, `y`: what is minimised, and where to start.
        """
        start = Point.unevaluated(y)
        no, zero = jnp.array(False), jnp.zeros((), jnp.int32)
        mixed = None
        if self.mixed_steps is not None and objective.mixed is not None:
            mixed = MixedState.off(_zeros_like(objective.mixed.strains, y), start)
        return NewtonState(
            point=start,
            factor=_zeros_like(lambda y: kept(self.linear_solver.factorise(objective.structure(y))), y),
            factorisations=zero,
            shift=None if self.shift is None else jnp.zeros(()),
            escaping=None if self.shift is None or self.saddle_escape is None else no,
            mixed=mixed,
            hopeless=None if self.max_hopeless is None or objective.hopeless is None else zero,
            done=no,
            stuck=no,
        )

    def step(self, objective: NewtonObjective, state: NewtonState) -> NewtonState:
        """One step.

        **Arguments:**

        - `objective`, `state`: what is minimised, and how far it is.
        """
        expansion, ahead = _expanded(objective, state)
        model = self._modelled(objective, state, expansion)
        step = self._proposed(objective, state, expansion, model)
        target = self.rtol * objective.length
        reached = descend(objective, step, self.line_search, self.corrections, model.solve, target)
        verdict = self._judged(objective, state, model, step, reached)

        point, shift, mixed, escaping = reached.point, verdict.shift, state.mixed, state.escaping
        if escaping is not None and self.saddle_escape is not None:
            escaping = self.saddle_escape.begins(model, step, reached, objective.length)
        if mixed is not None and ahead is not None and self.mixed_steps is not None:
            trusted = step.regular & ~verdict.settled & ~verdict.stuck
            mixed, point = self.mixed_steps.after(mixed, step, reached, trusted, objective.length, ahead)
            # Steps of this kind have no shift; those that follow begin without.
            shift = None if shift is None else jnp.where(mixed.on | step.mixed, 0.0, shift)
        if self.shift is None:
            point = choose(verdict.stuck, step.start, point)
        return NewtonState(
            point=point,
            factor=kept(model.factor),
            factorisations=state.factorisations + model.tries,
            shift=shift,
            escaping=escaping,
            mixed=mixed,
            hopeless=verdict.hopeless,
            done=verdict.settled,
            stuck=verdict.stuck,
        )

    def _modelled(self, objective: NewtonObjective, state: NewtonState, expansion: Expansion) -> QuadraticModel:
        """The quadratic model of a step, in which motions that cost nothing are held."""
        hessian = expansion.hessian
        basis = None if objective.motions is None else orthonormal(objective.motions(state.point.y))
        unit = hessian.size_of_diagonal()
        rhs = project_out(basis, -expansion.gradient)
        if basis is not None:
            hessian = hessian.gauged(gauge_coordinates(basis), unit)
        if self.shift is None or state.shift is None:
            factor, solution = self.linear_solver.factorise_and_solve(hessian, rhs)
            found = Factorised(factor, solution, jnp.zeros(()), jnp.ones((), jnp.int32))
        else:
            found = self.shift.factorise(
                self.linear_solver,
                hessian,
                expansion.convexification,
                rhs,
                unit=unit,
                last=state.factor,
                shift=state.shift,
                first=state.factorisations == 0,
                once=jnp.array(False) if state.mixed is None else state.mixed.on,
            )
        step, definite = project_out(basis, found.solution), positive_definite(found.factor)
        return QuadraticModel(self.linear_solver, found.factor, basis, step, found.shift, found.tries, definite)

    def _proposed(
        self, objective: NewtonObjective, state: NewtonState, expansion: Expansion, model: QuadraticModel
    ) -> Step:
        """The step to search along: that of the model, or one off a saddle."""
        direction, regular, no = model.step, model.definite, jnp.array(False)
        if state.escaping is not None and self.saddle_escape is not None:
            escape, (_, gradient, hessian, _) = self.saddle_escape, expansion
            direction = jax.lax.cond(
                state.escaping,
                lambda: escape.direction(hessian.mv, model.solve, gradient, objective.length),
                lambda: model.step,
            )
            regular = regular & ~state.escaping
        if self.shift is not None:
            regular = regular & (model.shift == 0)
        return Step(
            start=Point.of(state.point.y, expansion.value, expansion.gradient),
            direction=direction,
            size=jnp.max(jnp.abs(direction)),
            slope=expansion.gradient @ direction,
            regular=regular,
            escaping=no if state.escaping is None else state.escaping,
            mixed=no if state.mixed is None else state.mixed.on,
        )

    def _judged(
        self, objective: NewtonObjective, state: NewtonState, model: QuadraticModel, step: Step, reached: Reached
    ) -> _Verdict:
        """What is made of a step."""
        unit = objective.length
        small, distrusted = step.size <= self.rtol * unit, reached.stalled
        if self.line_search is not None:
            small = small | self.line_search.floored(step.size, reached.length, unit)
            distrusted = reached.length < self.line_search.short
        settled = step.regular & ~step.mixed & (reached.settled | small)

        lost = reached.stalled & ~step.escaping & ~settled & ~step.mixed
        if self.shift is None:
            # Nothing else is at hand against short steps, unless mixed ones are.
            shift, given_up = None, distrusted if state.mixed is None else lost
        else:
            shift = self.shift.after(model, step, reached, distrusted, lost, unit)
            given_up = lost & (shift > self.shift.largest)
        failed = given_up | ~model.definite | ~jnp.isfinite(reached.point.value)
        stuck = failed & ~settled & ~step.mixed

        hopeless = state.hopeless
        if hopeless is not None and objective.hopeless is not None and self.max_hopeless is not None:
            hopeless = jnp.where(objective.hopeless(step.start.y), hopeless + 1, 0)
            stuck = stuck | (~settled & (hopeless >= self.max_hopeless))
        return _Verdict(settled, stuck, shift, hopeless)


def _expanded(objective: NewtonObjective, state: NewtonState) -> tuple[Expansion, StrainsAhead | None]:
    """The energy about a point, with its strains where mixed steps have them; and where a step takes those."""
    y, mixed = state.point.y, state.mixed
    if objective.mixed is None or mixed is None:
        return Expansion(*objective.derivatives(y)), None
    value, gradient, hessian, convexification, ahead = objective.mixed.derivatives(y, mixed.strains, mixed.on)
    return Expansion(value, gradient, hessian, convexification), ahead


def _zeros_like(function: Callable[[Array], Any], y: Float[Array, " n"]) -> Any:
    """Zeros in the structure of what a function returns, which is not called."""
    structure = eqx.filter_eval_shape(function, y)
    return jax.tree.map(lambda struct: jnp.zeros(struct.shape, struct.dtype), structure)
