"""The second derivatives of all faces, and what makes them convex: where a Hessian has negative curvature, a minimiser
may take as much of it away as it must."""

import functools
import operator

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


_SMALLEST_PIVOT = 1e-3  # relative to the largest entry


Blocks = tuple[Float[Array, "9 9 F"], Float[Array, "3 w 9 F"] | None, Float[Array, "3 w 3 w F"] | None]
"""A symmetric matrix a face: between the coordinates of its corners, between the unknowns of each hinge and those, and
between the unknowns of hinges."""


class FaceHessians(eqx.Module):
    """Second derivatives of the energy on faces, in two parts.

    In the face's own k intrinsic numbers there is a small Hessian, which the derivatives of the numbers carry over to
    the unknowns. The other part is stress times the second derivatives of the numbers; it is given by pairs of corners,
    gathered from both faces of a hinge, so that its sum is exact and single elements are not.
    """

    corners: Float[Array, "k 9 F"]  # derivatives of the numbers in the coordinates of the corners
    hinges: Float[Array, "3 w F"] | None  # of each hinge in what it alone moves with: the vertex beyond, the director
    intrinsic: Float[Array, "k k F"]
    geometric: Float[Array, "6 3 3 F"]

    def stiffness(self) -> Blocks:
        """The first part, in the unknowns."""
        return self._in_unknowns(self.intrinsic)

    def lift(self) -> Blocks:
        """What, added to the first part, makes it positive definite but for motions that change none of the numbers."""
        diagonal = convexifying_diagonal(self.intrinsic)
        return self._in_unknowns(jnp.eye(len(diagonal))[:, :, None] * diagonal)

    def _in_unknowns(self, matrix: Float[Array, "k k F"]) -> Blocks:
        numbers = range(len(matrix))
        # Sums are spelled out over the numbers, and stay elementwise over faces; as products of small matrices they
        # took twice as long.
        carried = jnp.stack([_total([matrix[a, b] * self.corners[b] for b in numbers]) for a in numbers])
        # Kept in memory, or XLA computes it again for each row.
        carried = jax.lax.optimization_barrier(carried)
        among_corners = _total([self.corners[a][:, None] * carried[a] for a in numbers])
        if self.hinges is None:
            return among_corners, None, None
        among_hinges = self.hinges[:, :, None, None] * matrix[3:, None, 3:, None] * self.hinges
        return among_corners, self.hinges[:, :, None] * carried[3:, None], among_hinges


def _total(terms: list[Array]) -> Array:
    return functools.reduce(operator.add, terms)


def convexifying_diagonal(hessian: Float[Array, "k k F"]) -> Float[Array, "k F"]:
    """A diagonal that makes symmetric matrices positive definite when it is added; zero where they are well so already.

    The first three rows and the others may be in different units.

    ??? cite "Source"
        The modified Cholesky factorisation of P. Gill, W. Murray and M. Wright, "Practical Optimization" (1981),
        section 4.4.2.2, with pivots that keep their absolute value.
    """
    k = hessian.shape[0]
    scales = []
    for block in (slice(0, 3), slice(3, k)):
        largest = jnp.max(jnp.abs(hessian[block, block]), axis=(0, 1), initial=0.0)
        scales += [jnp.sqrt(jnp.where(largest > 0, largest, 1.0))] * len(range(*block.indices(k)))
    # Unrolled over the small axes: each entry is an array over all faces.
    rest = {(i, j): hessian[i, j] / (scales[i] * scales[j]) for i in range(k) for j in range(i, k)}
    added = []
    for i in range(k):
        below = [jnp.abs(rest[i, j]) for j in range(i + 1, k)]
        pivot = jnp.maximum(jnp.abs(rest[i, i]), _SMALLEST_PIVOT)
        if below:
            # No entry of the factor then exceeds the root of the largest entry of the matrix.
            pivot = jnp.maximum(pivot, jnp.max(jnp.stack(below), axis=0) ** 2)
        added.append((pivot - rest[i, i]) * scales[i] ** 2)
        for j in range(i + 1, k):
            for m in range(j, k):
                rest[j, m] = rest[j, m] - rest[i, j] * rest[i, m] / pivot
    return jnp.stack(added)


def negative_part(hessians: Float[Array, "N k 3 k 3"]) -> Float[Array, "N k 3 k 3"]:
    """What makes symmetric matrices positive semidefinite when it is added, and leaves their positive part alone.

    ??? cite "Source"
        J. Teran, E. Sifakis, G. Irving and R. Fedkiw, "Robust quasistatic finite elements and flesh simulation", Proc.
        ACM SIGGRAPH/Eurographics Symposium on Computer Animation (2005), 181–190, section 6.
    """
    n, k = hessians.shape[:2]
    eigenvalues, vectors = jnp.linalg.eigh(hessians.reshape(n, 3 * k, 3 * k))
    below = jnp.maximum(-eigenvalues, 0.0)
    return jnp.einsum("nai,ni,nbi->nab", vectors, below, vectors).reshape(hessians.shape)
