"""The second derivatives of all faces, and what makes them convex: where a Hessian has negative curvature, a minimiser
may take as much of it away as it must."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


_SMALLEST_PIVOT = 1e-3  # relative to the largest entry


class FaceHessians(eqx.Module):
    """Second derivatives of the energy on faces, in two parts.

    In the face's own k intrinsic numbers there is a small Hessian, which `rows`, the derivatives of the numbers in the
    m unknowns, carry over to the unknowns. The other part is stress times the second derivatives of the numbers; it is
    given by pairs of corners, gathered from both faces of a hinge, so that its sum is exact and single elements are
    not.
    """

    rows: Float[Array, "F k m"]
    intrinsic: Float[Array, "k k F"]
    geometric: Float[Array, "6 3 3 F"]

    def stiffness(self) -> Float[Array, "F m m"]:
        """The first part, in the unknowns."""
        return _contract(self.rows, _contract(jnp.transpose(self.intrinsic, (2, 0, 1)), self.rows))

    def lift(self) -> Float[Array, "F m m"]:
        """What, added to the first part, makes it positive definite but for motions that change none of the numbers."""
        return _contract(self.rows, convexifying_diagonal(self.intrinsic).T[:, :, None] * self.rows)


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


def _contract(a: Float[Array, "F k m"], b: Float[Array, "F k n"]) -> Float[Array, "F m n"]:
    """a^T b, face by face. As a batched product it also keeps XLA from recomputing its operands for each of its
    outputs."""
    return jax.lax.dot_general(a, b, (((1,), (1,)), ((0,), (0,))))
