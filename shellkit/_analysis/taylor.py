"""Whether a derivative is right: Taylor's test of the loss of a problem along a random direction."""

import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PyTree, Scalar

from .._fit.design import Design, split
from .._fit.step import objective, relaxation
from .._problem.states import Shape, Shell


_WIDEST = 1e-2  # of the typical size of an array: the largest step of the finite differences
_MAX_SHRINKS = 8
_NOISE_SPACING = 1e-9
_CLEARANCE = 1e3  # how far the smallest remainder lies above the noise
_LEVELS = 6  # of extrapolation


class TaylorReport(eqx.Module):
    r"""Whether the derivative of a loss is right; printing it gives a table.

    Along a random direction $d$, the remainder $|L(\theta + h d) - L(\theta) - h L'(\theta) d|$ falls with the square
    of $h$ if, and in the end only if, the derivative is right.
    """

    steps: Float[Array, " n_plus_1"]
    """The steps $h$, each half the one before, in units of the typical size of each array."""
    remainders: Float[Array, " n_plus_1"]
    """Of the loss at each step, in its unit."""
    slopes: Float[Array, " n"]
    """Between successive steps: 2 if the derivative is right, 1 if not."""
    error: Scalar
    """Relative difference between the adjoint derivative along the direction and extrapolated central differences."""
    tangent_error: Scalar
    """Relative difference between the adjoint derivative and the forward one."""
    derivative: Scalar
    """Along the direction, by the adjoint."""
    difference: Scalar
    """Along the direction, by central differences."""
    noise: Scalar
    """Rounding of the loss, as estimated from high differences: remainders below it say nothing."""
    converged: Bool[Array, ""]
    """Whether all relaxations did."""

    @property
    def passed(self) -> bool:
        """Whether all relaxations converged, each slope is 1.9 or more (or the remainder rounding), `error` is below
        1e-6 and `tangent_error` below 1e-10."""
        fine = (self.slopes >= 1.9) | (self.remainders[:-1] <= 10 * self.noise)
        return bool(self.converged & jnp.all(fine) & (self.error < 1e-6) & (self.tangent_error < 1e-10))

    def __str__(self) -> str:
        lines = ["     step    remainder  slope"]
        slopes = ["", *(f"{float(slope):5.2f}" for slope in self.slopes)]
        for h, remainder, slope in zip(self.steps, self.remainders, slopes, strict=True):
            lines.append(f"{float(h):9.2e}  {float(remainder):11.3e}  {slope}".rstrip())
        lines.append(f"derivative {float(self.derivative):.12e} by the adjoint")
        lines.append(f"off by {float(self.error):.1e} from differences")
        lines.append(f"off by {float(self.tangent_error):.1e} from the tangent")
        if not self.converged:
            lines.append("some relaxations did not converge")
        return "\n".join(lines)


def taylor_test(
    problem: Shell,
    where: Callable[[Any], PyTree] | None = None,
    seed: int = 0,
    halvings: int = 4,
    step: float | None = None,
) -> TaylorReport:
    """Test the derivative of a problem's loss along a random direction.

    The shell is relaxed anew at each step, from the equilibrium at hand. Steps are chosen as small as the rounding of
    the loss allows, where the test is sharpest.

    **Arguments:**

    - `problem`: with a loss; or several states of one.
    - `where`: a function from the problem to the array or arrays to differentiate in; by default those of the
        actuation.
    - `seed`: of the direction. Its entries are normal, times the typical size of their array.
    - `halvings`: of the step.
    - `step`: the largest step, in units of the typical size of each array; chosen automatically by default.

    **Returns:**

    The [`shellkit.TaylorReport`][].

    **Raises:**

    `ValueError` if the problem has no loss or `where` picks what has no derivative.

    ??? cite "Sources"

        Noise: J. Moré and S. Wild, "Estimating computational noise", SIAM J. Sci. Comput. 33 (2011), 1292–1314.
        Extrapolated differences: C. Ridders, "Accurate computation of F'(x) and F'(x)F''(x)", Adv. Eng. Software 4
        (1982), 75–76.
    """
    design, values = split(problem, where)
    direction = _direction(values, np.random.default_rng(seed))
    adjoint, tangent, equilibrium = _derivatives(design, values, direction)
    along = lambda h: _loss_along(design, values, direction, jnp.asarray(h, dtype=float), equilibrium)
    line = _Line(along, equilibrium)

    widest = line.widest_step()
    noise = line.noise()
    difference, curvature = line.central_difference(widest)
    smallest = math.sqrt(_CLEARANCE * noise / max(abs(curvature), 1e-300))
    first = min(smallest * 2**halvings, widest) if step is None else step
    steps = first * 0.5 ** np.arange(halvings + 1)
    # The loss here too is that of a relaxation from the equilibrium: a digit or two better than the first.
    remainders = np.array([abs(line(h) - line(0.0) - h * float(adjoint)) for h in steps])
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = np.log2(remainders[:-1] / remainders[1:])
    relative = lambda a, b: jnp.abs(a - b) / jnp.maximum(jnp.maximum(jnp.abs(a), jnp.abs(b)), noise / widest)
    return TaylorReport(
        steps=jnp.asarray(steps),
        remainders=jnp.asarray(remainders),
        slopes=jnp.asarray(slopes),
        error=relative(adjoint, difference),
        tangent_error=relative(adjoint, tangent),
        derivative=adjoint,
        difference=jnp.asarray(difference),
        noise=jnp.asarray(noise),
        converged=jnp.asarray(line.converged),
    )


def _direction(values: dict[str, Array], rng: np.random.Generator) -> dict[str, Array]:
    sizes = {name: float(jnp.sqrt(jnp.mean(value**2))) or 1.0 for name, value in values.items()}
    return {name: jnp.asarray(sizes[name] * rng.normal(size=value.shape)) for name, value in values.items()}


def _derivatives(design: Design, values: dict[str, Array], direction: dict[str, Array]) -> tuple[Scalar, Scalar, Shape]:
    """The derivative of the loss along a direction, by adjoint and by tangent, and the equilibrium."""
    return _responses(design, values, direction, relaxation(design.problem(values), None))


@eqx.filter_jit
def _responses(
    design: Design, values: dict[str, Array], direction: dict[str, Array], found: Any
) -> tuple[Scalar, Scalar, Shape]:
    def loss(values):
        value, (_, equilibrium) = objective(design.problem(values), found, None)
        return value, equilibrium

    value, forward, equilibrium = jax.linearize(loss, values, has_aux=True)
    (gradient,) = jax.linear_transpose(forward, values)(jnp.ones_like(value))
    adjoint = jax.tree.reduce(jnp.add, jax.tree.map(jnp.vdot, gradient, direction))
    return adjoint, forward(direction), equilibrium


def _loss_along(
    design: Design, values: dict[str, Array], direction: dict[str, Array], h: Scalar, start: Shape
) -> tuple[Scalar, Bool[Array, ""]]:
    """The loss some way along a direction, on the branch of equilibria that `start` is on; and if it converged."""
    moved = _moved(values, direction, h)
    return _loss_at(design, moved, relaxation(design.problem(moved), start))


@eqx.filter_jit
def _moved(values: dict[str, Array], direction: dict[str, Array], h: Scalar) -> dict[str, Array]:
    return jax.tree.map(lambda value, along: value + h * along, values, direction)


@eqx.filter_jit
def _loss_at(design: Design, values: dict[str, Array], found: Any) -> tuple[Scalar, Bool[Array, ""]]:
    value, (_, equilibrium) = objective(design.problem(values), found, None)
    return value, equilibrium.converged


class _Line:
    """A function of one number, evaluated on the host, that remembers whether it could be relied on."""

    def __init__(self, function: Callable[[float], tuple[Scalar, Bool[Array, ""]]], start: Shape):
        self.function = function
        self.converged = bool(start.converged)

    def __call__(self, h: float) -> float:
        value, converged = self.function(h)
        self.converged &= bool(converged)
        return float(value)

    def widest_step(self) -> float:
        """The largest step, of those tried, to which the relaxation converges on both sides."""
        step = _WIDEST
        for _ in range(_MAX_SHRINKS):
            if all(bool(converged) and math.isfinite(value) for value, converged in map(self.function, (step, -step))):
                return step
            step /= 4
        return step

    def noise(self) -> float:
        """Standard deviation of the rounding of the function, from fourth differences of values close together."""
        values = np.array([self(i * _NOISE_SPACING) for i in range(-4, 5)])
        differences = np.diff(values, 4)
        rounding = np.finfo(float).eps * np.max(np.abs(values))
        return max(math.sqrt(np.mean(differences**2) / math.comb(8, 4)), float(rounding))

    def central_difference(self, widest: float) -> tuple[float, float]:
        """The derivative by Ridders' extrapolation of central differences, and half the second derivative."""
        best, least, table, curvature = math.nan, math.inf, [], math.nan
        for level in range(_LEVELS):
            h = widest / 2**level
            ahead, behind = self(h), self(-h)
            row = [(ahead - behind) / (2 * h)]
            for order, earlier in enumerate(table, 1):
                row.append(row[-1] + (row[-1] - earlier) / (4**order - 1))
                error = max(abs(row[-1] - row[-2]), abs(row[-1] - earlier))
                if error < least:
                    best, least = row[-1], error
            table = row
            if level == _LEVELS // 2:
                curvature = (ahead + behind - 2 * self(0.0)) / (2 * h**2)
        return best, curvature
