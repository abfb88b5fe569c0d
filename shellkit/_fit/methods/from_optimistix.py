"""Least-squares solvers of optimistix, taken for the methods of this package that are of their kind."""

import dataclasses
import warnings
from collections.abc import Iterator
from typing import Any

import lineax as lx
import optimistix as optx

from .least_squares import Dogleg, GaussNewton, LeastSquares, LevenbergMarquardt


_OURS: dict[Any, type[LeastSquares]] = {
    optx.GaussNewton: GaussNewton,
    optx.LevenbergMarquardt: LevenbergMarquardt,
    optx.Dogleg: Dogleg,
}
_ITERATIVE = (lx.GMRES, lx.BiCGStab)  # those that cannot make the space in which steps are looked for


def from_optimistix(solver: optx.AbstractLeastSquaresSolver, stacklevel: int) -> LeastSquares:
    """The method of the same kind, with the solver's tolerances and norm, and the products that its linear solver asks
    for. A warning names what else of it was set, as it is not used.

    **Raises:** `ValueError` for a solver of another kind.
    """
    theirs = next((known for known in _OURS if isinstance(solver, known)), None)
    if theirs is None or not isinstance(solver, optx.AbstractGaussNewton):
        names = ", ".join(f"optimistix.{known.__name__}" for known in _OURS)
        raise ValueError(
            f"fit trains with the least-squares solvers {names}; got {type(solver).__name__}. Use one of them, or "
            "an optax optimiser."
        )
    linear: Any = _linear_solver(solver)
    inner = linear.inner_solver if isinstance(linear, lx.Normal) else linear
    ignored = [*_differing(solver, theirs(solver.rtol, solver.atol, solver.norm, linear)), *_unused(inner)]
    if ignored:
        ours = _OURS[theirs].__name__
        warnings.warn(
            f"fit: of optimistix.{theirs.__name__} these parts are set but not used: {', '.join(ignored)}. Leave them "
            f"as they are, or use shellkit.{ours}, of which each field counts.",
            stacklevel=stacklevel,
        )
    tolerances: dict[str, Any] = {"rtol": float(solver.rtol), "atol": float(solver.atol), "norm": solver.norm}
    if isinstance(inner, lx.CG | lx.LSMR):
        most: dict[str, Any] = {"products": inner.max_steps} if isinstance(inner.max_steps, int) else {}
        return _OURS[theirs](**tolerances, jacobian="krylov", accuracy=float(inner.rtol), **most)
    default = type(linear) is type(_linear_solver(theirs(rtol=1e-3, atol=1e-3)))
    return _OURS[theirs](**tolerances, jacobian="auto" if default else "dense")


def _linear_solver(solver: Any) -> lx.AbstractLinearSolver:
    return solver.descent.linear_solver


def _unused(inner: Any) -> Iterator[str]:
    """What of a linear solver was set and is not used."""
    if isinstance(inner, lx.CG | lx.LSMR):
        usual = type(inner)(rtol=inner.rtol, atol=0.0, max_steps=inner.max_steps)
        yield from (f"linear_solver.{name}" for name in _differing(inner, usual))
    elif isinstance(inner, _ITERATIVE):
        yield f"linear_solver ({type(inner).__name__})"


def _differing(part: Any, usual: Any) -> Iterator[str]:
    """The fields of a module that differ from those of another, or that it alone has."""
    absent = object()
    for field in dataclasses.fields(part):
        one, other = getattr(part, field.name), getattr(usual, field.name, absent)
        if one is not other and not (type(one) is type(other) and bool(one == other)):
            yield field.name
