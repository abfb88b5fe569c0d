"""Relaxation with quantities of the whole shell held at their values: multipliers are sought about the minimiser.

For given multipliers and a penalty the shape is a minimum like any other. How its residuals depend on the multipliers
follows from the factor at hand, so that these converge as Newton's method does, to residuals of rounding."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int, Scalar

from .._energy import DiscreteEnergy
from .._solve.adjoint import differentiable_minimum
from .._solve.linear.base import AbstractSparseSolver
from .._solve.linear.bordered import Bordered, BorderedFactor, BorderedSolver
from .._solve.newton.core import Newton
from .._solve.newton.objective import NewtonObjective
from .._solve.null_space import orthonormal, pseudo_inverse_solve


_MAX_ROUNDS = 16
_ROUNDING = 2e-15  # of a gap, relative to the sum of its gradient's entries times positions
_CLOSE = 1e-10  # a gap that no round makes smaller is taken for rounding below this
_CONTRACTION = 0.25  # a round that does not cut the residuals to this raises the penalties
_RAISE = 10.0


class ConstrainedState(eqx.Module):
    """Where a relaxation with multipliers has come to."""

    y: Float[Array, " n"]
    multipliers: Float[Array, " m"]
    """With those of springs, minus stiffness times gap."""
    estimates: Float[Array, " m"]
    penalties: Float[Array, " m"]
    gap: Scalar
    """The largest gap of what is held exactly, in units of its rounding."""
    value: Scalar
    gradient: Float[Array, " n"]
    steps: Int[Array, ""]
    factorisations: Int[Array, ""]
    result: optx.RESULTS
    rounds: Int[Array, ""]
    settled: Bool[Array, ""]

    @classmethod
    def begin(
        cls, y: Float[Array, " n"], estimates: Float[Array, " m"], penalties: Float[Array, " m"]
    ) -> "ConstrainedState":
        """Before the first round, of which only these three are looked at."""
        none = jnp.zeros((), jnp.int32)
        return cls(
            y=y,
            multipliers=jnp.zeros_like(estimates),
            estimates=estimates,
            penalties=penalties,
            gap=jnp.asarray(jnp.inf),
            value=jnp.zeros(()),
            gradient=y,
            steps=none,
            factorisations=none,
            result=optx.RESULTS.successful,
            rounds=none,
            settled=jnp.array(False),
        )


def relax_constrained(
    newton: Newton,
    objective: Callable[[DiscreteEnergy], NewtonObjective],
    energy: DiscreteEnergy,
    y: Float[Array, " n"],
    multipliers: Float[Array, " m"] | None,
    max_steps: int,
) -> ConstrainedState:
    """The minimum of an energy with its quantities at their values.

    **Arguments:**

    - `newton`: with a linear solver of bordered matrices.
    - `objective`: from an energy to what the method is told of it.
    - `energy`: with the quantities; nothing of it is differentiated.
    - `y`, `multipliers`: where to start.
    - `max_steps`: of the method, for each round.
    """
    motions = objective(energy).motions
    constraints = energy.constraints
    assert constraints is not None
    exact = jnp.asarray(constraints.exact)
    zero = jnp.zeros(len(exact))
    first = zero if multipliers is None else jnp.where(exact, multipliers, 0.0)
    start = ConstrainedState.begin(y, first, jnp.where(exact, _penalties(energy, y), constraints.penalties))

    def once(now: ConstrainedState) -> ConstrainedState:
        augmented = energy.with_multipliers(now.estimates, now.penalties)
        state, steps = newton.minimise(objective(augmented), now.y, max_steps)
        result, point = state.result, state.point
        converged = result == optx.RESULTS.successful
        residuals, jacobian = energy.constraint_residuals(point.y), energy.constraint_jacobian(point.y)
        gap = jnp.max(jnp.where(exact, jnp.abs(residuals) / (_ROUNDING * (jnp.abs(jacobian) @ jnp.abs(point.y))), 0.0))
        worse = ~(gap < _CONTRACTION * now.gap)
        settled = converged & ((gap <= 1) | (worse & (gap * _ROUNDING < _CLOSE)))

        # The residuals as a function of the multipliers have the slope G A⁻¹ Gᵀ at the minimum.
        basis = None if motions is None else orthonormal(motions(point.y))
        assert isinstance(state.factor, BorderedFactor)
        moves = jnp.stack([pseudo_inverse_solve(newton.linear_solver, state.factor, basis, row) for row in jacobian])
        slope = jnp.where(exact[:, None] & exact[None, :], jacobian @ moves.T, jnp.diag(1.0 + zero))
        change = -jnp.linalg.solve(slope, jnp.where(exact, residuals, 0.0))
        simple = jnp.where(exact, -now.penalties * residuals, 0.0)
        usable = converged & jnp.all(jnp.isfinite(change))
        change = jnp.where(usable, change, simple)
        return ConstrainedState(
            y=jnp.where(usable & ~settled, point.y + change @ moves, point.y),
            multipliers=now.estimates - now.penalties * residuals,
            estimates=now.estimates + change,
            penalties=jnp.where(exact & worse, _RAISE * now.penalties, now.penalties),
            gap=gap,
            value=point.value,
            gradient=point.gradient,
            steps=now.steps + steps,
            factorisations=now.factorisations + state.factorisations,
            result=result,
            rounds=now.rounds + 1,
            settled=settled,
        )

    return jax.lax.while_loop(lambda now: ~now.settled & (now.rounds < _MAX_ROUNDS), once, start)


def _penalties(energy: DiscreteEnergy, y: Float[Array, " n"]) -> Float[Array, " m"]:
    """Stiffnesses beside which no uniform motion of the shell is stiff: the mean diagonal of its Hessian, estimated by
    one product, over the square of each gradient."""
    signs = jax.random.rademacher(jax.random.key(0), y.shape, y.dtype)
    image = jax.jvp(energy.gradient, (y,), (signs,))[1]
    jacobian = energy.constraint_jacobian(y)
    square = jnp.sum(jacobian**2, axis=1)
    return jnp.abs(signs @ image) / len(y) / jnp.where(square > 0, square, 1.0)


class Stationary(eqx.Module):
    """The energy with its multipliers as unknowns behind the others: at a minimum its gradient vanishes in all."""

    energy: DiscreteEnergy

    def _at(self, z: Float[Array, " k"]) -> tuple[DiscreteEnergy, Float[Array, " n"], Float[Array, " m"]]:
        constraints = self.energy.constraints
        assert constraints is not None
        n = len(z) - len(constraints.targets)
        return self.energy.with_multipliers(z[n:]), z[:n], constraints.compliances

    def gradient(self, z: Float[Array, " k"]) -> Float[Array, " k"]:
        energy, y, compliances = self._at(z)
        return jnp.concatenate([energy.gradient(y), -energy.constraint_residuals(y) - compliances * z[len(y) :]])

    def hessian(self, z: Float[Array, " k"]) -> Bordered:
        energy, y, compliances = self._at(z)
        hessian = energy.hessian(y)
        assert isinstance(hessian, Bordered)
        return Bordered(hessian.sparse, hessian.rows, compliances, eliminated=False)


class _Padded(eqx.Module):
    """Motions of the unknowns as motions of unknowns and multipliers, of which the latter have no part."""

    motions: Callable[[Array], Array]
    m: int = eqx.field(static=True)

    def __call__(self, z: Float[Array, " k"]) -> Float[Array, "k d"]:
        return jnp.pad(self.motions(z[: len(z) - self.m]), ((0, self.m), (0, 0)))


def padded(motions: Callable[[Array], Array] | None, m: int) -> _Padded | None:
    """Motions of unknowns with `m` multipliers behind them; `None` for none."""
    return None if motions is None else _Padded(motions, m)


def differentiable_constrained(
    energy: DiscreteEnergy,
    y: Float[Array, " n"],
    multipliers: Float[Array, " m"],
    motions: Callable[[Array], Array] | None,
    linear_solver: AbstractSparseSolver,
) -> tuple[Float[Array, " n"], Float[Array, " m"]]:
    """Unknowns and multipliers of a relaxation, with their derivatives in all arrays of the energy."""
    z = jnp.concatenate([y, multipliers])
    m = len(multipliers)
    z = differentiable_minimum(Stationary(energy), z, padded(motions, m), BorderedSolver(linear_solver))
    return z[: len(y)], z[len(y) :]
