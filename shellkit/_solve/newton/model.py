"""The quadratic model of a Newton step: a matrix that was factorised, and the step to the minimum of the model."""

from typing import Any

import equinox as eqx
from jaxtyping import Array, Bool, Float, Int, Scalar

from ..linear.base import Factor, LastFactor
from ..linear.bordered import BorderedFactor
from ..matrices.operator import SparseSymmetric
from ..null_space import pseudo_inverse_solve
from .objective import Hessian


AnyFactor = Factor | BorderedFactor
KeptFactor = LastFactor | BorderedFactor
"""What is kept of a factor from one step to the next: without the pattern, which all matrices share."""


def kept(factor: AnyFactor) -> KeptFactor:
    """What is kept of a factor."""
    return LastFactor.of(factor) if isinstance(factor, Factor) else factor


def restored(last: KeptFactor, hessian: Hessian) -> AnyFactor:
    """The factor of which this was kept, of a matrix of the structure of `hessian`."""
    if isinstance(last, BorderedFactor):
        return last
    assert isinstance(hessian, SparseSymmetric)  # whose factors are kept so
    return last.factor(hessian.pattern)


def positive_definite(factor: AnyFactor) -> Bool[Array, ""]:
    """Whether the matrix is; a solver that cannot count negative eigenvalues says so by failing."""
    return factor.ok & (factor.negative <= 0)


class Factorised(eqx.Module):
    """A shifted Hessian with its factor, and the solution for one right-hand side."""

    factor: AnyFactor
    solution: Float[Array, " n"]
    shift: Scalar
    tries: Int[Array, ""]
    """How many shifts were tried."""


class QuadraticModel(eqx.Module):
    """A quadratic model and how to solve with its matrix."""

    linear_solver: Any
    factor: AnyFactor
    basis: Float[Array, "n k"] | None
    """Of the motions that cost nothing."""
    step: Float[Array, " n"]
    """To the minimum of the model."""
    shift: Scalar
    tries: Int[Array, ""]
    definite: Bool[Array, ""]

    def solve(self, rhs: Float[Array, " n"]) -> Float[Array, " n"]:
        """The inverse of the matrix on a vector. It is not checked: a direction that is none shows in the energy."""
        return pseudo_inverse_solve(self.linear_solver, self.factor, self.basis, rhs, checked=False)
