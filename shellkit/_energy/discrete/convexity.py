"""The second derivatives of all faces, and what makes them convex: where a Hessian has negative curvature, a minimiser
may take as much of it away as it must."""

import functools
import operator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
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

    def pull_back(self, stress: Float[Array, "k F"]) -> Float[Array, "m F"]:
        """First derivatives in the unknowns of each face, corners, far vertices and directors, from those in the
        numbers."""
        among_corners = _total([stress[a] * self.corners[a] for a in range(len(stress))])
        if self.hinges is None:
            return among_corners
        own = stress[3:, None] * self.hinges
        far = own[:, :3].reshape(9, -1)
        return jnp.concatenate([among_corners, far, own[:, 3:].reshape(-1, far.shape[1])])

    def along(self, motions: Float[Array, "m F"]) -> Float[Array, "k F"]:
        """The change of the numbers with the unknowns of each face: what `pull_back` is the transpose of."""
        change = jnp.sum(self.corners * motions[:9], axis=1)
        if self.hinges is None:
            return change
        own = jnp.concatenate([motions[9:18].reshape(3, 3, -1), motions[18:].reshape(3, -1, motions.shape[1])], axis=1)
        return change.at[3:].add(jnp.sum(self.hinges * own, axis=1))

    def stiffness(self) -> Blocks:
        """The first part, in the unknowns."""
        # Sums are spelled out over the numbers, and stay elementwise over faces; as products of small matrices they
        # took twice as long.
        corners = list(self.corners)
        carried = jnp.stack(
            [_total([number * c for number, c in zip(row, corners, strict=True)]) for row in self.intrinsic]
        )
        return self._in_unknowns(carried, self.intrinsic[3:, 3:])

    def lift(self) -> Blocks:
        """What, added to the first part, makes it positive definite but for motions that change none of the numbers."""
        diagonal = convexifying_diagonal(self.intrinsic)
        among_hinges = None if self.hinges is None else jnp.eye(3)[:, :, None] * diagonal[3:]
        return self._in_unknowns(diagonal[:, None] * self.corners, among_hinges)

    def _in_unknowns(self, carried: Float[Array, "k 9 F"], among_hinges: Float[Array, "h h F"] | None) -> Blocks:
        """A matrix in the numbers, by its product with their derivatives and its part between half angles."""
        # Kept in memory, or XLA computes it again for each row.
        carried = jax.lax.optimization_barrier(carried)
        among_corners = _total([self.corners[a][:, None] * carried[a] for a in range(len(carried))])
        if self.hinges is None or among_hinges is None:
            return among_corners, None, None
        among_hinges = self.hinges[:, :, None, None] * among_hinges[:, None, :, None] * self.hinges
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
    largest = [jnp.max(jnp.abs(hessian[block, block]), axis=(0, 1), initial=0.0) for block in _blocks(k)]
    scales = jnp.stack([jnp.sqrt(jnp.where(size > 0, size, 1.0)) for size in largest])[np.arange(k) // 3]
    # Rows are taken one after the other, each an array over all faces.
    rest = hessian / (scales[:, None] * scales)
    added = []
    for i in range(k):
        pivot = jnp.maximum(jnp.abs(rest[i, i]), _SMALLEST_PIVOT)
        if i + 1 < k:
            # No entry of the factor then exceeds the root of the largest entry of the matrix.
            pivot = jnp.maximum(pivot, jnp.max(jnp.abs(rest[i, i + 1 :]), axis=0) ** 2)
        added.append(pivot - rest[i, i])
        rest = rest - rest[i][:, None] * (rest[i] / pivot)
    return jnp.stack(added) * scales**2


def _blocks(k: int) -> list[slice]:
    return [slice(start, start + 3) for start in range(0, k, 3)]


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
