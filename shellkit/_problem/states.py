"""One design in several states: the same arrays under other stimuli, loads, supports and targets."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PyTree, Scalar

from .._energy import Unknowns
from .._equilibrium import RESULTS, Equilibrium
from .._programs.tracing import is_traced
from .._relaxation.relaxed import Relaxed
from .problem import InverseProblem
from .selection import name_of, named_arrays, selected


class Equilibria(eqx.Module):
    """The equilibria of the states of a design, by name: `equilibria["hot"]`.

    What is said of a single equilibrium is said of all of them together: steps add up, all must have converged.
    """

    states: dict[str, Equilibrium]
    """An equilibrium for each state."""

    def __getitem__(self, name: str) -> Equilibrium:
        return self.states[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.states)

    def __len__(self) -> int:
        return len(self.states)

    def keys(self):
        """The names of the states."""
        return self.states.keys()

    def values(self):
        """The equilibria, in the order of the states."""
        return self.states.values()

    def items(self):
        """Names and equilibria."""
        return self.states.items()

    @property
    def unknowns(self) -> dict[str, Unknowns]:
        """Positions and directors of each state."""
        return {name: state.unknowns for name, state in self.states.items()}

    def with_unknowns(self, unknowns: dict[str, Unknowns]) -> "Equilibria":
        """The same with other positions and directors, as where to start from."""
        return Equilibria({name: state.with_unknowns(unknowns[name]) for name, state in self.states.items()})

    @property
    def energy(self) -> Scalar:
        """The sum of the energies."""
        return sum((state.energy for state in self.states.values()), jnp.zeros(()))

    @property
    def gradient_norm(self) -> Scalar:
        """The largest of all."""
        return jnp.max(jnp.stack([state.gradient_norm for state in self.states.values()]))

    @property
    def steps(self) -> Int[Array, ""]:
        """Of the minimiser, in all states together."""
        return jnp.sum(jnp.stack([state.steps for state in self.states.values()]))

    @property
    def factorisations(self) -> Int[Array, ""]:
        """Of the Hessian, in all states together."""
        return jnp.sum(jnp.stack([state.factorisations for state in self.states.values()]))

    @property
    def converged(self) -> Bool[Array, ""]:
        """Whether all did."""
        return jnp.all(jnp.stack([state.converged for state in self.states.values()]))

    @property
    def stable(self) -> Bool[Array, ""]:
        """Whether all are."""
        return jnp.all(jnp.stack([state.stable for state in self.states.values()]))

    @property
    def result(self) -> Any:
        """That of the first state that did not converge; of the last one where all did."""
        states = list(self.states.values())
        found: Any = states[-1].result
        for state in states[-2::-1]:
            result: Any = state.result
            found = RESULTS.where(state.converged, found, result)
        return found


class States(eqx.Module):
    """One design in several states: the same arrays under other stimuli, loads, supports or targets, trained together.

    Each state is an [`shellkit.InverseProblem`][]. The arrays that `shared` picks are stored once, and all states have
    them; everything else may differ from state to state. The loss is the weighted sum of those of the states, and its
    terms are named by state, as in `"hot.VertexDistance"`. States are relaxed one after another, those of one kind by
    one compiled program.

    It goes wherever a problem goes: [`shellkit.fit`][] with gradients or least squares, checkpoints,
    [`shellkit.fit_many`][], [`shellkit.taylor_test`][], [`shellkit.identifiability`][]. `states["hot"]` is the problem
    of one state; `states.actuation` and the like lead to what is shared, for a `where`.

    ??? example

        ```python
        states = sk.States(
            {"warm": shell(stretch=0.95), "hot": shell(stretch=0.85)}, shared=lambda p: p.actuation.top.angle
        )
        result = sk.fit(states, optax.adam(0.1), steps=100, where=lambda p: p.actuation.top.angle)
        result.problem["hot"]()
        ```

    When not to use it: for designs that have nothing in common, [`shellkit.fit_many`][] keeps them apart.
    """

    shared: dict[str, Array]
    own: dict[str, InverseProblem]  # without what is shared
    weights: dict[str, Float[Array, ""]]
    names: tuple[str, ...] = eqx.field(static=True)
    after: tuple[tuple[str, str], ...] = eqx.field(static=True)

    def __init__(
        self,
        states: Mapping[str, Any],
        shared: Callable[[InverseProblem], PyTree] | Iterable[str],
        weights: Mapping[str, float | Array] | None = None,
        after: Mapping[str, str] | Iterable[tuple[str, str]] | None = None,
    ):
        """**Arguments:**

        - `states`: the problems, by name.
        - `shared`: a function from a problem to the arrays, or parts, that all states have in common, as for the
            `where` of [`shellkit.fit`][]; or their names, such as `["actuation.top.angle"]`. All states must have them
            with equal values.
        - `weights`: of the losses, by name; 1 for those that are not named.
        - `after`: the states that are relaxed from the equilibrium of another, as in `{"cooled": "hot"}`; the others
            are relaxed from rest.

        **Raises:** `ValueError` without states, for names that are none, for arrays that differ between states, and for
        states each of which would come after the other.
        """
        if not states:
            raise ValueError("States: there are no states; give at least one, as in {'hot': problem}.")
        for name, state in states.items():
            if not isinstance(state, InverseProblem):
                raise ValueError(f"States: {name!r} is a {type(state).__name__}; give an InverseProblem.")
        self.names = tuple(states)
        pairs: Any = after.items() if isinstance(after, Mapping) else (after or ())
        self.after = _in_order(self.names, {name: earlier for name, earlier in pairs if earlier})
        unknown = [name for name in (weights or {}) if name not in states]
        if unknown:
            raise ValueError(f"States: weights names {unknown[0]!r}, which is none of {', '.join(states)}.")
        self.weights = {name: jnp.asarray((weights or {}).get(name, 1.0), dtype=float) for name in self.names}
        first = self.names[0]
        arrays = named_arrays(states[first])
        picked = selected(states[first], shared, "States.shared") if callable(shared) else list(shared)
        absent = [name for name in picked if name not in arrays]
        if absent:
            raise ValueError(f"States: {first!r} has no array {absent[0]}; it has {', '.join(arrays)}.")
        self.shared = {name: leaf for name, leaf in arrays.items() if name in picked}
        for name, state in states.items():
            _check_shared(name, named_arrays(state), first, self.shared)
        blank = lambda path, leaf: None if path in self.shared else leaf
        self.own = {name: _map_named(blank, state) for name, state in states.items()}

    @property
    def states(self) -> dict[str, InverseProblem]:
        """The problem of each state, by name."""
        return {name: self[name] for name in self.names}

    def __getitem__(self, name: str) -> InverseProblem:
        if name not in self.own:
            raise KeyError(f"there is no state {name!r}; there are {', '.join(self.names)}")
        filled = lambda path, leaf: self.shared.get(path, leaf)
        return _map_named(filled, self.own[name])

    def __getattr__(self, name: str) -> Any:
        # Where a `where` looks for what is shared. All other arrays are absent: they belong to a single state.
        if name.startswith("_") or name not in InverseProblem.__dataclass_fields__:
            raise AttributeError(f"'States' has no attribute {name!r}; a single state is states['name'].")
        common = lambda path, leaf: self.shared.get(path, None if eqx.is_array(leaf) else leaf)
        return getattr(_map_named(common, self.own[self.names[0]]), name)

    def __call__(self, start: Equilibria | None = None) -> Equilibria:
        """Relax all states.

        **Arguments:**

        - `start`: equilibria to start from; by default the surfaces at rest.

        **Returns:** the [`shellkit.Equilibria`][], by name.
        """
        found: dict[str, Equilibrium] = {}
        for name, earlier in self.after:
            found[name] = self[name](self._start(name, earlier, start, found))
        return Equilibria({name: found[name] for name in self.names})

    def _start(self, name: str, earlier: str, start: Equilibria | None, found: Mapping[str, Any]) -> Any:
        if earlier:
            return found[earlier]
        return None if start is None else start[name]

    def relaxed(self, start: Equilibria | None = None) -> dict[str, Relaxed | None]:
        """The relaxations alone, of which nothing is differentiated; `None` where the loss of a state does not look at
        its shape.

        **Arguments:**

        - `start`: as when it is called.
        """
        found: dict[str, Relaxed | None] = {}
        leads = {earlier for _, earlier in self.after}
        for name, earlier in self.after:
            state = self[name]
            begin = self._start(name, earlier, start, found)
            needed = state.needs_shape or name in leads
            found[name] = state.relaxed(begin.start if isinstance(begin, Relaxed) else begin) if needed else None
        return {name: found[name] for name in self.names}

    @property
    def needs_shape(self) -> bool:
        """Whether a loss looks at a relaxed shape."""
        return any(state.needs_shape for state in self.own.values())

    def objective(self, start: Equilibria | None = None) -> tuple[Scalar, tuple[dict[str, Scalar], Equilibria]]:
        """The loss, with its terms by name of state and term, and the equilibria that they were measured at.

        **Arguments:**

        - `start`: as when it is called.

        **Raises:** `ValueError` if a state has no loss.
        """
        return self.respond(self.relaxed(start))

    def respond(self, found: dict[str, Relaxed | None]) -> tuple[Scalar, tuple[dict[str, Scalar], Equilibria]]:
        """What `objective` returns, from relaxations that were done before; differentiable all the same.

        **Arguments:**

        - `found`: what `relaxed` returned at the present arrays.
        """
        total, terms, equilibria = jnp.zeros(()), {}, {}
        for name in self.names:
            state, relaxed = self[name], found[name]
            loss, (of_state, equilibria[name]) = state.objective() if relaxed is None else state.respond(relaxed)
            total = total + self.weights[name] * loss
            terms |= {f"{name}.{term}": value for term, value in of_state.items()}
        return total, (terms, Equilibria(equilibria))

    def evaluate(self) -> tuple[Scalar, dict[str, Scalar]]:
        """The loss of the relaxed states, and the unweighted value of each of its terms by name of state and term."""
        value, (terms, _) = self.objective()
        return value, terms

    def near(self, equilibria: Equilibria) -> Equilibria:
        """Equilibria that were found before, as functions of every array, to first order; see
        [`shellkit.InverseProblem.near`][].

        **Arguments:**

        - `equilibria`: of these states at their present arrays.
        """
        return Equilibria({name: self[name].near(equilibria[name]) for name in self.names})

    def residuals(self, equilibria: Equilibria) -> Float[Array, " m"]:
        """The numbers whose squares sum to the loss, of all states; see [`shellkit.InverseProblem.residuals`][].

        **Arguments:**

        - `equilibria`: of these states at their present arrays.

        **Raises:** `ValueError` if the loss of a state is no sum of squares, or its weight is negative.
        """
        parts = []
        for name in self.names:
            weight = self.weights[name]
            if not is_traced(weight) and float(weight) < 0:
                raise ValueError(f"States: the weight of {name!r} is negative, so the loss is no sum of squares.")
            parts.append(jnp.sqrt(weight) * self[name].residuals(equilibria[name]))
        return jnp.concatenate(parts)

    def unrelaxed(self) -> Equilibria:
        """The surfaces at rest as equilibria that nothing was done to."""
        return Equilibria({name: self[name].unrelaxed() for name in self.names})

    def citation(self) -> str:
        """The papers behind all states, as BibTeX."""
        entries: dict[str, None] = {}
        for name in self.names:
            entries |= dict.fromkeys(self[name].citation().split("\n\n"))
        return "\n\n".join(entries)


Shell = InverseProblem | States
Shape = Equilibrium | Equilibria


def _in_order(names: tuple[str, ...], after: dict[str, str]) -> tuple[tuple[str, str], ...]:
    """Each state with the one that it comes after, an empty name for none, in an order in which they can be relaxed."""
    for name in (*after, *after.values()):
        if name not in names:
            raise ValueError(f"States: after names {name!r}, which is none of {', '.join(names)}.")
    order: list[tuple[str, str]] = []
    left = list(names)
    while left:
        done = {name for name, _ in order}
        ready = [name for name in left if after.get(name, "") in ("", *done)]
        if not ready:
            raise ValueError(f"States: {' and '.join(left)} would each have to come after the other.")
        order += [(name, after.get(name, "")) for name in ready]
        left = [name for name in left if name not in ready]
    return tuple(order)


def _check_shared(name: str, arrays: Mapping[str, Array], first: str, shared: Mapping[str, Array]) -> None:
    for path, value in shared.items():
        other = arrays.get(path)
        if other is None:
            raise ValueError(f"States: {name!r} has no array {path}, which {first!r} has and which is to be shared.")
        if other is value or is_traced((other, value)):
            continue
        if other.shape != value.shape or not np.array_equal(np.asarray(other), np.asarray(value)):
            raise ValueError(
                f"States: {path} is to be shared, but differs between {first!r} and {name!r}; give both the same array."
            )


def _map_named(function: Callable[[str, Any], Any], problem: InverseProblem) -> InverseProblem:
    """A problem with each leaf, and each part that is absent, as a function of its name and of itself."""
    absent = lambda leaf: leaf is None
    named = lambda path, leaf: function(name_of(path), leaf)
    return jax.tree_util.tree_map_with_path(named, problem, is_leaf=absent)
