"""Newton's method where nothing goes wrong: what `SparseNewton` does as long as the Hessian is positive definite and
its steps need not be cut short. A program of this alone takes half as long to compile."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Int

from ..linear.base import LastFactor
from ..null_space import coordinates_to_hold, orthonormal, project_out
from .newton import SHORT, SparseNewton, blank_like, descend, floored, scene_of, solve_held, usable
from .points import Point


class PlainState(eqx.Module):
    """State of [`PlainNewton`][] between two steps."""

    point: Point
    factor: LastFactor
    factorisations: Int[Array, ""]
    done: Bool[Array, ""]
    stuck: Bool[Array, ""]

    @property
    def best(self) -> Point:
        """Where the search is."""
        return self.point


class PlainNewton(optx.AbstractMinimiser):
    """The steps of a [`shellkit.SparseNewton`][] without its means against saddles, indefinite Hessians and narrow
    valleys. Where it would need one of them it stops as stuck, at the point where that solver has to go on; up to there
    both take the same steps.

    It is told about the function as that one is.
    """

    rtol: float
    linear_solver: Any  # an AbstractSparseSolver: there are no constraints here, whose matrices have another
    atol: float
    norm: Any

    def __init__(self, like: SparseNewton):
        """**Arguments:**

        - `like`: the solver whose steps it takes.
        """
        self.rtol, self.atol, self.norm = like.rtol, like.atol, like.norm
        self.linear_solver = like.linear_solver

    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> PlainState:
        scene = scene_of(fn, args, options)
        zero, no = jnp.zeros((), y.dtype), jnp.array(False)
        factor = blank_like(lambda y: LastFactor.of(self.linear_solver.factorise(scene.structure(y))), y)
        return PlainState(Point(y, zero, jnp.zeros_like(y), zero), factor, jnp.zeros((), jnp.int32), no, no)

    def step(self, fn, y, args, options, state: PlainState, tags):
        scene = scene_of(fn, args, options)
        value, gradient, hessian, _ = scene.derivatives(y)
        point = Point.of(y, value, gradient)
        basis = None if scene.motions is None else orthonormal(scene.motions(y))
        if basis is not None:
            hessian = hessian.gauged(coordinates_to_hold(basis), hessian.size_of_diagonal())
        factor, newton = self.linear_solver.factorise_and_solve(hessian, project_out(basis, -gradient))
        direction = project_out(basis, newton)
        size = jnp.max(jnp.abs(direction))
        solve = lambda rhs: solve_held(self.linear_solver, factor, basis, rhs, checked=False)
        no, yes = jnp.array(False), jnp.array(True)
        moved, length, settled = descend(scene, point, direction, size, solve, no, yes, no, self.rtol)
        settled = usable(factor) & (settled | floored(size, length, scene, self.rtol))
        stuck = ~settled & ((length < SHORT) | ~usable(factor) | ~moved.finite)
        point = jax.tree.map(lambda here, there: jnp.where(stuck, here, there), point, moved)
        state = PlainState(point, LastFactor.of(factor), state.factorisations + 1, settled, stuck)
        return point.y, state, None

    def terminate(self, fn, y, args, options, state: PlainState, tags):
        result = optx.RESULTS.where(state.stuck, optx.RESULTS.nonlinear_divergence, optx.RESULTS.successful)
        return state.done | state.stuck, result

    def postprocess(self, fn, y, aux, args, options, state: PlainState, tags, result):
        return state.point.y, aux, {"factorisations": state.factorisations}
