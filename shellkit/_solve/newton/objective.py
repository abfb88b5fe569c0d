"""What a Newton method asks of the function that it minimises."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree, Scalar

from ..linear.bordered import Bordered
from ..matrices.operator import SparseSymmetric


Hessian = SparseSymmetric | Bordered
Function = Callable[[Array, Any], tuple[Scalar, Any]]
"""As optimistix has it: `(y, args) -> ` the value, and whatever else."""
Convexification = Callable[[], SparseSymmetric]
StrainsAhead = Callable[[Array], PyTree[Array]]


class Expansion(NamedTuple):
    """An energy to second order about a point, and what to add to its Hessian so that it is positive semidefinite, as a
    function, since most Hessians need none of it; `None` where nothing is known to do so."""

    value: Scalar
    gradient: Float[Array, " n"]
    hessian: Hessian
    convexification: Convexification | None


class MixedForm(NamedTuple):
    """An energy with its strains as unknowns of their own."""

    strains: Callable[[Array], PyTree[Array]]
    """`y -> ` the strains there."""
    derivatives: Callable[[Array, PyTree[Array], Array], tuple[Any, ...]]
    """`(y, strains, at_strains) -> ` the fields of an `Expansion`, at those strains or at those of `y`, and
    `step -> ` the strains to which it leads."""


class NewtonObjective(eqx.Module):
    """A function of one flat vector, and what a Newton method can make use of."""

    value_and_gradient: Callable[[Array], tuple[Scalar, Array]]
    derivatives: Callable[[Array], tuple[Scalar, Array, Hessian, Convexification | None]]
    """`y -> ` the fields of an `Expansion`."""
    structure: Callable[[Array], Hessian]
    """`y -> ` a matrix like the Hessian, whose values do not count."""
    length: Scalar
    """A typical length, against which steps are measured."""
    feasible: Callable[[Array, Array], Bool[Array, ""]] | None = None
    """`(y, y_new) -> ` whether a step may be taken; `None` if all may."""
    motions: Callable[[Array], Float[Array, "n k"]] | None = None
    """`y -> ` motions that cost nothing; `None` if there are none."""
    mixed: MixedForm | None = None
    hopeless: Callable[[Array], Bool[Array, ""]] | None = None
    """`y -> ` whether no minimum can be found from there; `None` if nothing is known."""

    @classmethod
    def from_options(cls, fn: Function, args: Any, options: dict[str, Any]) -> "NewtonObjective":
        """What a function and the options of `optimistix.minimise` say; see [`shellkit.SparseNewton`][]. An objective
        among these, as a relaxation has it, is taken as it is.

        **Raises:** `ValueError` if there is no Hessian.
        """
        if "objective" in options:
            return options["objective"]
        if "hessian" not in options and "derivatives" not in options:
            raise ValueError(
                'SparseNewton needs a sparse Hessian: pass options={"hessian": y -> operator} to optimistix.minimise, '
                "or use an InverseProblem, which does; optimistix.BFGS and optimistix.NonlinearCG need none."
            )
        first = options.get("value_and_gradient", jax.value_and_grad(lambda y: fn(y, args)[0]))
        derivatives = options.get("derivatives", lambda y: (*first(y), options["hessian"](y), None))
        mixed = options.get("apart")
        return cls(
            value_and_gradient=first,
            derivatives=derivatives,
            structure=options.get("structure", lambda y: derivatives(y)[2]),
            length=jnp.asarray(options.get("length", 1.0)),
            feasible=options.get("feasible"),
            motions=options.get("motions"),
            mixed=None if mixed is None else MixedForm(*mixed),
            hopeless=options.get("hopeless"),
        )
