"""Arc-length continuation: equilibria followed through limit points, where a load has to fall, and past bifurcations.

How much of the load is on is an unknown like the others; the length of the step along the path of equilibria is what is
given."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Scalar

from .._energy import DiscreteEnergy, Unknowns
from .._equilibrium import Diagnostics, Equilibrium
from .._geometry.surface import edge_lengths
from .._problem.problem import InverseProblem
from .._programs.renamed import formerly
from .._programs.tracing import is_traced
from .._relaxation.augmented_lagrangian import Stationary, padded
from .._solve.linear.bordered import Bordered, BorderedSolver
from .._solve.null_space import gauged_hessian, pseudo_inverse_solve


_MAX_CORRECTIONS = 12
_TOLERANCE = 1e-11  # of the last correction, relative to an edge
_FEW = 4  # corrections that are neither many nor few: steps grow where they take less, and shrink where more
_GROWTH = 1.6
_RESOLUTION = 1e-9  # of a step, to which the place of a critical point is found
_INVERSE_ITERATIONS = 6


class ArcLength(eqx.Module):
    """Steps of a length along the path of equilibria, from nothing on: through snap-through and snap-back.

    A step that does not converge is halved; one that converges at once makes the next one longer. Use
    [`shellkit.Ramp`][] where the load only rises and the shape at its end is all that is wanted: that is cheaper, and
    its end can be differentiated.
    """

    first: float = eqx.field(static=True)
    steps: int = eqx.field(static=True)
    longest: float = eqx.field(static=True)
    halvings: int = eqx.field(static=True)

    def __init__(self, first: float = 0.05, steps: int = 200, longest: float = 4.0, halvings: int = 8):
        """**Arguments:**

        - `first`: the progress, of 1, that the first step makes.
        - `steps`: how many there may be.
        - `longest`: a step over the first one in length.
        - `halvings`: how short one may become: the first over two to this power.

        **Raises:**

        `ValueError` for numbers that are not positive.
        """
        if not first > 0 or steps < 1 or not longest > 0 or halvings < 0:
            raise ValueError(f"ArcLength({first=}, {steps=}, {longest=}, {halvings=}): all of them must be positive.")
        self.first, self.steps, self.longest, self.halvings = float(first), steps, float(longest), halvings


class CriticalPoint(eqx.Module):
    """An equilibrium on a path where stability changes: a limit point, or a bifurcation."""

    kind: str = eqx.field(static=True)
    """`"limit point"`, where progress turns round, or `"bifurcation"`, where another path crosses."""
    progress: Float[Array, ""]
    """How much of actuation, loads and motion is on there."""
    equilibrium: Equilibrium
    """The shape there."""
    mode: Float[Array, "V 3"]
    """The direction in which the equilibrium is neither stable nor unstable, as displacements of length one in all."""
    unknowns: Float[Array, " k"]
    """The free unknowns there, with the multipliers behind them where the energy has constraints."""
    null: Float[Array, " k"]
    """The mode in these, with the change of the multipliers."""


class Branch(eqx.Module):
    """Equilibria along a path, in the order in which they were met; printing it shows them as a table."""

    progress: Float[Array, " n"]
    """How much of actuation, loads and motion is on at each; it falls where the path turns back."""
    equilibria: tuple[Equilibrium, ...]
    """One for each entry of `progress`."""
    negative: Int[Array, " n"]
    """How many eigenvalues of the Hessian are negative at each; 0 is stable."""
    critical: tuple[CriticalPoint, ...]
    """The limit points and bifurcations on the way."""
    complete: bool = eqx.field(static=True)
    """Whether the whole of the load was reached; else it ran out of steps, or of halvings."""

    @property
    def vertices(self) -> Float[Array, "n V 3"]:
        """Positions along the path."""
        return jnp.stack([equilibrium.vertices for equilibrium in self.equilibria])

    @property
    def energies(self) -> Float[Array, " n"]:
        """Energies along the path."""
        return jnp.stack([equilibrium.energy for equilibrium in self.equilibria])

    def __str__(self) -> str:
        lines = ["progress        energy  negative"]
        for progress, at, negative in zip(self.progress, self.equilibria, self.negative, strict=True):
            lines.append(f"{float(progress):8.5f}  {float(at.energy):12.5e}  {int(negative):8d}")
        lines += [f"{point.kind} at {float(point.progress):.6f}" for point in self.critical]
        return "\n".join(lines)


class _Point(eqx.Module):
    """A point on a path, and the direction in which the path goes on, of unit length in shape and progress.

    Multipliers, where there are constraints, stand behind the free unknowns. They are no part of any length: what unit
    they have depends on the constraint.
    """

    y: Float[Array, " k"]
    progress: Scalar
    along: Float[Array, " k"]
    progress_along: Scalar
    negative: Int[Array, ""]
    converged: Bool[Array, ""]
    corrections: Int[Array, ""]
    gradient_norm: Scalar


def continue_path(
    problem: InverseProblem, path: ArcLength | None = None, start: Equilibrium | None = None, end: float = 1.0
) -> Branch:
    """Follow equilibria from none of actuation, loads and prescribed motion to all of them, wherever the path leads.

    The number of negative eigenvalues follows from the factor at each point. Where it changes limit points or
    bifurcations lie between, which are then found by bisection; two of them within one step that undo each other's
    change are not seen, so take shorter steps where they lie close. Where the energy has constraints, eigenvalues are
    those of motions that keep what is held. On the host; not for use under `jax.jit`, and not differentiable:
    [`shellkit.relax`][] from an equilibrium found here is.

    The linear solver has to tell the inertia of a matrix: not [`shellkit.Cholmod`][].

    **Arguments:**

    - `problem`: the shell.
    - `path`: by default `ArcLength()`.
    - `start`: the equilibrium at no progress; by default the surface at rest.
    - `end`: the progress at which to stop; as much in the other direction stops too.

    **Returns:**

    The [`shellkit.Branch`][], its last equilibrium at `end` if it is complete.

    **Raises:**

    `ValueError` if there is no equilibrium to start from, and under transformations.

    ??? cite "Source"

        H. B. Keller, "Numerical solution of bifurcation and nonlinear eigenvalue problems", in P. H. Rabinowitz (ed.),
        "Applications of Bifurcation Theory" (Academic Press, 1977), 359–384: pseudo-arclength. The signs of pivots as
        in E. Riks, "An incremental approach to the solution of snapping and buckling problems", Int. J. Solids Struct.
        15 (1979), 529–551.
    """
    path = ArcLength() if path is None else path
    if is_traced((problem, start)):
        raise ValueError("continue_path takes as many steps as it needs, so it cannot be traced by JAX: use relax.")
    y = problem.assembly.dofs.gather(Unknowns(problem.mesh.vertices) if start is None else start.unknowns)
    constraints = problem.discrete_energy().constraints
    if constraints is not None:
        held = None if start is None else start.multipliers
        y = jnp.concatenate([y, jnp.zeros(len(constraints.targets)) if held is None else held])
    zero, none = jnp.zeros(()), jnp.zeros_like(y)
    # Counted so that, at the start, progress and displacement have equal parts in the length of a step.
    here = _corrected(problem, y, zero, none, jnp.ones(()), jnp.ones(()))
    if not here.converged:
        raise ValueError(
            "continue_path: there is no equilibrium at the start, with nothing of the load on. Relax problem.at(0.0), "
            "and give the result as start."
        )
    weight = jnp.sum((_shape(problem, here.along) / here.progress_along) ** 2)
    here = _corrected(problem, here.y, here.progress, here.along, here.progress_along, weight)
    here = _towards(here, here.progress_along)
    return _walk(problem, path, here, weight, path.first / here.progress_along, end)


trace = formerly("trace", continue_path)


def switch_branch(
    problem: InverseProblem, point: CriticalPoint, size: float, path: ArcLength | None = None, end: float = 1.0
) -> Branch:
    """Leave a path at a bifurcation, for the one that crosses it there.

    **Arguments:**

    - `problem`: the shell.
    - `point`: a bifurcation on a [`shellkit.Branch`][] of it.
    - `size`: how far to go along its mode at first, as the largest displacement of a vertex; with a minus, the other
        way.
    - `path`: how to go on; the length of its first step is that of `size`.
    - `end`: the progress at which to stop.

    **Returns:**

    The [`shellkit.Branch`][], from the first point off the bifurcation on.

    **Raises:**

    `ValueError` if no other path is found at this distance.
    """
    path = ArcLength() if path is None else path
    scale = size / jnp.max(jnp.linalg.norm(point.mode, axis=1))
    weight, zero = jnp.ones(()), jnp.zeros(())
    ahead = point.null * jnp.sign(scale)
    there = _corrected(problem, point.unknowns + scale * point.null, point.progress, ahead, zero, weight)
    if not there.converged:
        raise ValueError("switch_branch: no other path at this distance from the bifurcation; give a smaller size.")
    there = _towards(there, _shape(problem, ahead) @ _shape(problem, there.along))
    return _walk(problem, path, there, weight, jnp.abs(scale) * jnp.linalg.norm(_shape(problem, point.null)), end)


def _walk(problem: InverseProblem, path: ArcLength, here: _Point, weight: Scalar, first: Scalar, end: float) -> Branch:
    """Steps from a point on, of a length that adapts."""
    length, points, critical, complete = float(first), [here], [], False
    while len(points) <= path.steps and length >= float(first) / 2**path.halvings:
        there = _step(problem, here, jnp.asarray(length), weight)
        turned = _product(problem, there, here, weight) if there.converged else 0.0
        if not there.converged or turned < 0.5:
            length *= 0.5
            continue
        if (float(there.progress) - end) * (float(here.progress) - end) <= 0 and float(here.progress) != end:
            share = (end - here.progress) / (there.progress - here.progress)
            guess = here.y + share * (there.y - here.y)
            last = _corrected(problem, guess, jnp.asarray(end), jnp.zeros_like(guess), jnp.ones(()), weight)
            if last.converged:
                there, complete = last, True
        critical += _between(problem, here, (0.0, here), (length, there), weight, _RESOLUTION * length)
        points.append(there)
        if complete or float(there.progress) <= -abs(end):
            break
        corrections = max(int(there.corrections), 1)
        length = min(length * min(_GROWTH, _FEW / corrections), path.longest * float(first))
        here = there
    equilibria = tuple(_equilibrium(problem, point) for point in points)
    return Branch(
        progress=jnp.stack([point.progress for point in points]),
        equilibria=equilibria,
        negative=jnp.stack([point.negative for point in points]),
        critical=tuple(critical),
        complete=complete,
    )


def _between(
    problem: InverseProblem,
    here: _Point,
    low: tuple[float, _Point],
    high: tuple[float, _Point],
    weight: Scalar,
    resolution: float,
) -> list[CriticalPoint]:
    """The points at which stability changes on the way from one: by bisection of the step, of both halves where it
    changes in both. `low` and `high` are lengths of the step, and where they lead."""
    (first, before), (last, after) = low, high
    turns = float(before.progress_along) * float(after.progress_along) < 0
    if int(before.negative) == int(after.negative) and not turns:
        return []
    middle = 0.5 * (first + last)
    if last - first > resolution:
        point = _step(problem, here, jnp.asarray(middle), weight)
        if point.converged:
            parts = ((low, (middle, point)), ((middle, point), high))
            return [found for part in parts for found in _between(problem, here, *part, weight, resolution)]
    null = _null(problem, after)
    mode = problem.assembly.dofs.motion(_shape(problem, null)).vertices
    return [
        CriticalPoint(
            kind="limit point" if turns else "bifurcation",
            progress=after.progress,
            equilibrium=_equilibrium(problem, after),
            mode=mode / jnp.linalg.norm(mode),
            unknowns=after.y,
            null=null / jnp.linalg.norm(mode),
        )
    ]


def _shape(problem: InverseProblem, unknowns: Float[Array, " k"]) -> Float[Array, " n"]:
    """The free unknowns, without the multipliers behind them."""
    return unknowns[: problem.assembly.pattern.n]


def _product(problem: InverseProblem, one: _Point, other: _Point, weight: Scalar) -> float:
    """The cosine between the directions at two points."""
    along = _shape(problem, one.along) @ _shape(problem, other.along)
    return float(along + weight * one.progress_along * other.progress_along)


def _towards(point: _Point, sign: Scalar) -> _Point:
    """The point with the direction of its path turned round if a number is negative."""
    directions = lambda p: (p.along, p.progress_along)
    turn = jnp.where(sign < 0, -1.0, 1.0)
    return eqx.tree_at(directions, point, (turn * point.along, turn * point.progress_along))


def _step(problem: InverseProblem, here: _Point, length: Scalar, weight: Scalar) -> _Point:
    """The point at a distance along the tangent, corrected in the plane square to it."""
    guess = here.y + length * here.along
    progress = here.progress + length * here.progress_along
    return _corrected(problem, guess, progress, here.along, here.progress_along, weight)


@eqx.filter_jit
def _corrected(
    problem: InverseProblem,
    y: Float[Array, " k"],
    progress: Scalar,
    along: Float[Array, " k"],
    progress_along: Scalar,
    weight: Scalar,
) -> _Point:
    """The equilibrium in the plane through a point square to a direction, by Newton's method in all unknowns and
    progress; and the direction of the path there."""
    edge = jnp.mean(edge_lengths(problem.mesh.vertices, problem.mesh))
    product = lambda a, b: _shape(problem, a) @ _shape(problem, b)

    def look(carry):
        at, t, *_, count = carry
        gradient, change, solve, factor, lengths = _linearised(problem, at, t)
        step, slope = -solve(gradient), -solve(change)
        # In the plane: along · (y + step + δ slope − y₀) + weight progress_along (t + δ − t₀) = 0.
        off = product(along, at + step - y) + weight * progress_along * (t - progress)
        delta = -off / (product(along, slope) + weight * progress_along)
        size = jnp.max(jnp.abs(step + delta * slope) * lengths)
        # The direction of the path: where the solution goes as progress does.
        scale = jnp.sqrt(product(slope, slope) + weight)
        sign = jnp.where(product(along, slope) + weight * progress_along < 0, -1.0, 1.0)
        point = _Point(
            at, t, sign * slope / scale, sign / scale, factor.negative, size < _TOLERANCE * edge, count,
            jnp.linalg.norm(_shape(problem, gradient)),
        )  # fmt: skip
        return at + step + delta * slope, t + delta, point, count + 1

    def unsolved(carry):
        at, _, point, count = carry
        return ~point.converged & (count < _MAX_CORRECTIONS) & jnp.all(jnp.isfinite(at))

    no, zero = jnp.array(False), jnp.zeros(())
    blank = _Point(y, progress, along, progress_along, jnp.zeros((), jnp.int32), no, jnp.zeros((), int), zero)
    return jax.lax.while_loop(unsolved, look, (y, progress, blank, jnp.zeros((), int)))[2]


def _linearised(problem: InverseProblem, y: Float[Array, " k"], progress: Scalar):
    """Gradient, its change with progress, the function that solves with the Hessian, and its factor; last, what makes
    a length of each unknown: one, and of a multiplier how far its force moves a vertex."""
    energy = lambda t: _with_multipliers(problem.at(t).discrete_energy())
    gradient, change = jax.jvp(lambda t: energy(t).gradient(y), (progress,), (jnp.ones_like(progress),))
    now = problem.at(progress)
    hessian: Any = energy(progress).hessian(y)
    motions, solver = now.rigid_modes(), problem.linear_solver()
    lengths = jnp.ones_like(y)
    if isinstance(hessian, Bordered):
        forces = jnp.max(jnp.abs(hessian.rows), axis=1)
        lengths = lengths.at[hessian.n :].set(forces / hessian.size_of_diagonal())
        motions, solver = padded(motions, len(forces)), BorderedSolver(solver)
    hessian, basis, _ = gauged_hessian(hessian, motions, y)
    factor = solver.factorise(hessian)
    return gradient, change, lambda rhs: pseudo_inverse_solve(solver, factor, basis, rhs), factor, lengths


def _with_multipliers(energy: DiscreteEnergy) -> DiscreteEnergy | Stationary:
    """The energy; where quantities are held, as a function of their multipliers too."""
    return energy if energy.constraints is None else Stationary(energy)


@eqx.filter_jit
def _null(problem: InverseProblem, point: _Point) -> Float[Array, " k"]:
    """The direction in which the Hessian nearly vanishes, by inverse iteration."""
    _, _, solve, *_ = _linearised(problem, point.y, point.progress)
    vector = jax.random.normal(jax.random.key(0), point.y.shape, point.y.dtype)
    refine = lambda _, v: (lambda w: w / jnp.linalg.norm(w))(solve(v))
    vector = jax.lax.fori_loop(0, _INVERSE_ITERATIONS, refine, vector)
    shape = _shape(problem, vector)
    return vector * jnp.sign(shape[jnp.argmax(jnp.abs(shape))])


@eqx.filter_jit
def _equilibrium(problem: InverseProblem, point: _Point) -> Equilibrium:
    now = problem.at(point.progress)
    energy = now.discrete_energy()
    y, multipliers = _shape(now, point.y), None
    if energy.constraints is not None:
        multipliers = point.y[len(y) :]
    found = eqx.tree_at(
        lambda d: (d.energy, d.gradient_norm, d.steps, d.stable),
        Diagnostics.of_nothing(),
        (energy(y), point.gradient_norm, point.corrections, point.negative == 0),
    )
    return Equilibrium.of(now.mesh, now.rest_shape(), now.posed(energy, y, multipliers=multipliers), found)
