"""Sparse symmetric matrices with a few dense rows at their border, which are never filled in.

A quantity of the whole shell, such as its volume, has a gradient with as many entries as there are unknowns. It stands
beside the sparse matrix, and costs one more right-hand side of the same factor."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Bool, Float, Int

from ..matrices.operator import SparseSymmetric
from .base import AbstractSparseSolver, Factor


class Bordered(lx.AbstractLinearOperator):
    r"""The symmetric matrix

    $$\begin{pmatrix} S & -G^T \\ -G & -C \end{pmatrix}$$

    of a sparse $S$, $m$ dense rows $G$ and compliances $C \ge 0$ on a diagonal; or, `eliminated`, what is left of it
    for the unknowns of $S$ alone, $S + G^T C^{-1} G$.
    """

    sparse: SparseSymmetric
    rows: Float[Array, "m n"]
    compliances: Float[Array, " m"]
    eliminated: bool = eqx.field(static=True)

    @property
    def n(self) -> int:
        """The size of the sparse part."""
        return self.sparse.pattern.n

    def mv(self, vector: Float[Array, " k"]) -> Float[Array, " k"]:
        if self.eliminated:
            return self.sparse.mv(vector) + (self.rows @ vector / self.compliances) @ self.rows
        inner, border = vector[: self.n], vector[self.n :]
        return jnp.concatenate(
            [self.sparse.mv(inner) - border @ self.rows, -self.rows @ inner - self.compliances * border]
        )

    def as_matrix(self) -> Float[Array, "k k"]:
        sparse = self.sparse.as_matrix()
        if self.eliminated:
            return sparse + (self.rows.T / self.compliances) @ self.rows
        return jnp.block([[sparse, -self.rows.T], [-self.rows, -jnp.diag(self.compliances)]])

    def transpose(self) -> "Bordered":
        return self

    def in_structure(self) -> jax.ShapeDtypeStruct:
        size = self.n if self.eliminated else self.n + len(self.rows)
        return jax.ShapeDtypeStruct((size,), self.rows.dtype)

    def out_structure(self) -> jax.ShapeDtypeStruct:
        return self.in_structure()

    def size_of_diagonal(self) -> Float[Array, ""]:
        """The mean size of the diagonal entries of the sparse part."""
        return self.sparse.size_of_diagonal()

    def shifted(self, shift: Float[Array, ""] | float) -> "Bordered":
        """This matrix plus `shift` times the identity on the sparse part."""
        return self._with(self.sparse.shifted(shift), self.rows)

    def plus(self, values: Float[Array, " nnz"]) -> "Bordered":
        """This matrix plus another one of the pattern of the sparse part, given by its values."""
        return self._with(self.sparse.plus(values), self.rows)

    def gauged(self, coordinates: Int[Array, " k"], stiffness: Float[Array, ""]) -> "Bordered":
        """This matrix with a spring on some coordinates of the sparse part."""
        return self._with(self.sparse.gauged(coordinates, stiffness), self.rows)

    def _with(self, sparse: SparseSymmetric, rows: Array) -> "Bordered":
        return Bordered(sparse, rows, self.compliances, self.eliminated)


@lx.linearise.register(Bordered)
@lx.materialise.register(Bordered)
@lx.conj.register(Bordered)
def _(operator):
    return operator


@lx.is_symmetric.register(Bordered)
def _(operator):
    return True


@lx.is_diagonal.register(Bordered)
@lx.is_tridiagonal.register(Bordered)
@lx.is_lower_triangular.register(Bordered)
@lx.is_upper_triangular.register(Bordered)
@lx.has_unit_diagonal.register(Bordered)
@lx.is_positive_semidefinite.register(Bordered)
@lx.is_negative_semidefinite.register(Bordered)
def _(operator):
    return False


class BorderedFactor(eqx.Module):
    """A factor of the sparse part, with its solutions for the dense rows."""

    sparse: Factor
    rows: Float[Array, "m n"]
    solved: Float[Array, "m n"]
    capacitance: Float[Array, "m m"]
    """What is left for the border once the sparse part is eliminated: $C + G S^{-1} G^T$."""
    negative: Int[Array, ""]
    """How many directions of negative curvature are left: eigenvalues of $S + G^T C^{-1} G$ where compliances are
    positive; where they are zero, of $S$ on the directions that the rows do not see. -1 if it is not known."""
    ok: Bool[Array, ""]


class BorderedSolver(eqx.Module):
    """Factorises [`Bordered`][] matrices with a solver of their sparse part.

    The inertia follows from that of the sparse part by Haynsworth's rule: `negative` is that of $S$ less the number of
    negative eigenvalues of the capacitance.

    ??? cite "Source"

        E. Haynsworth, "Determination of the inertia of a partitioned Hermitian matrix", Linear Algebra Appl. 1 (1968),
        73–81; the solution is that of Woodbury, see N. Higham, "Accuracy and Stability of Numerical Algorithms", 2nd
        edition (2002), section 26.
    """

    papers: ClassVar[tuple[str, ...]] = ()
    inner: AbstractSparseSolver

    def factorise(self, operator: Bordered) -> BorderedFactor:
        """See [`AbstractSparseSolver.factorise`][]."""
        return self._completed(self.inner.factorise(operator.sparse), operator)

    def factorise_and_solve(
        self, operator: Bordered, rhs: Float[Array, " k"]
    ) -> tuple[BorderedFactor, Float[Array, " k"]]:
        """Both at once."""
        factor = self.factorise(operator)
        return factor, self.solve(factor, rhs)

    def _completed(self, sparse: Factor, operator: Bordered) -> BorderedFactor:
        rows = jax.lax.stop_gradient(operator.rows)
        solved = self.inner.solve(sparse, rows)
        capacitance = solved @ rows.T
        capacitance = jnp.diag(jax.lax.stop_gradient(operator.compliances)) + 0.5 * (capacitance + capacitance.T)
        finite = jnp.all(jnp.isfinite(capacitance))
        curvatures = jnp.linalg.eigvalsh(jnp.where(finite, capacitance, jnp.eye(len(rows))))
        fewer = jnp.sum(curvatures < 0).astype(sparse.negative.dtype)
        negative = jnp.where(sparse.negative < 0, -1, sparse.negative - fewer)
        return BorderedFactor(sparse, rows, solved, capacitance, negative, sparse.ok & finite)

    def solve(self, factor: BorderedFactor, rhs: Float[Array, "*b k"], checked: bool = True) -> Float[Array, "*b k"]:
        """Solves for right-hand sides of the size of the sparse part (the border eliminated) or of the whole."""
        n = factor.rows.shape[1]
        inner = self.inner.solve(factor.sparse, rhs[..., :n], checked)
        force = inner @ factor.rows.T
        whole = rhs.shape[-1] > n
        if whole:
            force = force + rhs[..., n:]
        border = -jnp.linalg.solve(factor.capacitance, force[..., None])[..., 0]
        inner = inner + border @ factor.solved
        return jnp.concatenate([inner, border], axis=-1) if whole else inner
