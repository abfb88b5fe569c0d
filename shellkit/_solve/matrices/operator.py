"""A sparse symmetric matrix as a lineax operator: a fixed pattern and the values of its upper triangle."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Float, Inexact, Int, PyTree

from .pattern import SymmetricPattern


Structure = tuple[tuple[jax.ShapeDtypeStruct, ...], jax.tree_util.PyTreeDef]


class SparseSymmetric(lx.AbstractLinearOperator):
    """The symmetric linear map with the given values at the non-zeros of a pattern.

    It acts on any pytree of arrays that ravels to $n$ numbers: a flat vector, the (V, 3) positions of a mesh, or
    positions and edge rotations together. It is differentiable, forwards and backwards, in `values` and in the vector.
    """

    pattern: SymmetricPattern
    values: Inexact[Array, "nnz"]
    structure: Structure = eqx.field(static=True)

    def __init__(self, pattern: SymmetricPattern, values: Inexact[Array, "nnz"], like: PyTree | None = None):
        """**Arguments:**

        - `pattern`: where the non-zeros of the upper triangle lie.
        - `values`: their values, of shape (nnz,).
        - `like`: a pytree of arrays (or of `jax.ShapeDtypeStruct`), of $n$ numbers in all, whose structure the vectors
            have. A flat vector of shape (n,) if left out.

        **Raises:**

        `ValueError` if the shapes do not fit the pattern.
        """
        if values.shape != (pattern.nnz,):
            raise ValueError(
                f"values have shape {values.shape}, but the pattern has {pattern.nnz} non-zeros: "
                f"expected ({pattern.nnz},)"
            )
        if like is None:
            like = jax.ShapeDtypeStruct((pattern.n,), values.dtype)
        leaves, treedef = jax.tree_util.tree_flatten(like)
        size = sum(math.prod(leaf.shape) for leaf in leaves)
        if size != pattern.n:
            shapes = [tuple(leaf.shape) for leaf in leaves]
            raise ValueError(f"the vector's shapes {shapes} hold {size} numbers, but the matrix has size {pattern.n}")
        self.pattern = pattern
        self.values = values
        self.structure = (tuple(jax.ShapeDtypeStruct(leaf.shape, values.dtype) for leaf in leaves), treedef)

    def mv(self, vector: PyTree[Inexact[Array, "..."]]) -> PyTree[Inexact[Array, "..."]]:
        flat, unravel = jax.flatten_util.ravel_pytree(vector)
        return unravel(symmetric_product(self.pattern, self.values, flat))

    def as_matrix(self) -> Inexact[Array, "n n"]:
        rows, columns, n = self.pattern.rows, self.pattern.indices, self.pattern.n
        upper = jnp.zeros((n, n), self.values.dtype).at[rows, columns].set(self.values)
        return upper + jnp.triu(upper, 1).T

    def transpose(self) -> "SparseSymmetric":
        return self

    def in_structure(self) -> PyTree[jax.ShapeDtypeStruct]:
        leaves, treedef = self.structure
        return jax.tree_util.tree_unflatten(treedef, leaves)

    def out_structure(self) -> PyTree[jax.ShapeDtypeStruct]:
        return self.in_structure()

    def shifted(self, shift: Float[Array, ""] | float) -> "SparseSymmetric":
        """This matrix plus `shift` times the identity."""
        values = self.values.at[self.pattern.diagonal].add(shift, **_SORTED)
        return eqx.tree_at(lambda operator: operator.values, self, values)

    def gauged(self, coordinates: Int[Array, " k"], stiffness: Float[Array, ""]) -> "SparseSymmetric":
        """This matrix with a spring on some coordinates, those of motions that it does not resist: regular, and of the
        same inertia but for as many positive eigenvalues. Where it and the right-hand side do no work on these motions
        the springs carry nothing, so that the solution is one of the matrix itself.

        Coordinates past the last are passed over.
        """
        places = self.pattern.diagonal.at[coordinates].get(
            mode="fill", fill_value=self.pattern.nnz, wrap_negative_indices=False
        )
        values = self.values.at[places].add(stiffness, mode="drop", wrap_negative_indices=False)
        return eqx.tree_at(lambda operator: operator.values, self, values)

    def plus(self, values: Float[Array, "nnz"]) -> "SparseSymmetric":
        """This matrix plus another one of the same pattern, given by its values."""
        return eqx.tree_at(lambda operator: operator.values, self, self.values + values)

    def size_of_diagonal(self) -> Float[Array, ""]:
        """The mean size of the diagonal entries."""
        return jnp.mean(jnp.abs(taken(self.values, self.pattern.diagonal)))


def symmetric_product(
    pattern: SymmetricPattern, values: Inexact[Array, "nnz"], vector: Inexact[Array, "n"]
) -> Inexact[Array, "n"]:
    """The matrix with these values times a flat vector: the upper triangle by rows, the strict lower one by columns."""
    # Of gathers over padded rows, cumulative sums, XLA's own CSR product and this, on a CPU this is fastest but for a
    # loop over padded columns (0.19 against 0.11 ms at 642 vertices), which one long row would blow up.
    rows, columns = pattern.rows, pattern.indices
    below = jnp.where(rows == columns, 0, values)
    upper = jnp.zeros_like(vector).at[rows]
    upper = upper.add(values * taken(vector, columns), indices_are_sorted=True, wrap_negative_indices=False)
    return upper.at[columns].add(below * taken(vector, rows), wrap_negative_indices=False)


# Indices of a pattern are those of its own matrix: none is looked at, which would be compiled for each use.
_SORTED: dict[str, Any] = {"unique_indices": True, "indices_are_sorted": True, "wrap_negative_indices": False}


def taken(values: Array, places: Int[Array, "*n"]) -> Array:
    """The values at places that are known to be there."""
    return values.at[places].get(mode="promise_in_bounds", wrap_negative_indices=False)


@lx.linearise.register(SparseSymmetric)
@lx.materialise.register(SparseSymmetric)
@lx.conj.register(SparseSymmetric)
def _(operator):
    return operator


@lx.diagonal.register(SparseSymmetric)
def _(operator):
    return operator.values[operator.pattern.diagonal]


@lx.tridiagonal.register(SparseSymmetric)
def _(operator):
    matrix = operator.as_matrix()
    return jnp.diagonal(matrix), jnp.diagonal(matrix, -1), jnp.diagonal(matrix, 1)


@lx.is_symmetric.register(SparseSymmetric)
def _(operator):
    return True


@lx.is_diagonal.register(SparseSymmetric)
@lx.is_tridiagonal.register(SparseSymmetric)
@lx.is_lower_triangular.register(SparseSymmetric)
@lx.is_upper_triangular.register(SparseSymmetric)
@lx.has_unit_diagonal.register(SparseSymmetric)
@lx.is_positive_semidefinite.register(SparseSymmetric)
@lx.is_negative_semidefinite.register(SparseSymmetric)
def _(operator):
    return False
