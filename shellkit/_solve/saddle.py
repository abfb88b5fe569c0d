"""The way off a saddle."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Scalar


_INVERSE_ITERATIONS, _LOBPCG_STEPS = 8, 16
_BALANCE = 1e-6  # forces below this part of what the softest step would raise are those of a saddle
_SLOPE = 1e-3  # along a direction of negative curvature, a slope below this part of it is rounding


def away_from_saddle(
    product: Callable[[Array], Array], solve: Callable[[Array], Array], gradient: Float[Array, " n"], length: Scalar
) -> Float[Array, " n"]:
    """A step off a saddle: along the softest direction of the convex model, by inverse iteration with its factor; or,
    where that is stable, along the lowest direction of the Hessian, if forces balance, or if the energy falls along it
    by more than it would rise along the softest.

    A shell buckles along its soft modes. What is unstable, but stiffer, while forces are out of balance is often stable
    where they lead, and ends in crumpled states. The step goes downhill; where both ways do, it is always the same
    one, so that problems that differ by little stay on one branch.

    **Arguments:**

    - `product`: with the Hessian.
    - `solve`: with the matrix that was made convex and factorised.
    - `gradient`: where the step begins.
    - `length`: the largest entry of the step.
    """
    scaled = lambda v: length / jnp.max(jnp.abs(v)) * v
    start = jax.random.normal(jax.random.key(0), gradient.shape, gradient.dtype)
    softest = jax.lax.fori_loop(0, _INVERSE_ITERATIONS, lambda _, v: scaled(solve(v)), start)
    rise = softest @ product(softest)

    def choose():
        lowest = scaled(_lowest(product, solve, start))
        balanced = jnp.linalg.norm(gradient) * jnp.linalg.norm(softest) < _BALANCE * rise
        return jnp.where(balanced | (lowest @ product(lowest) < -rise), lowest, softest)

    step = jax.lax.cond(rise > 0, choose, lambda: softest)
    uphill = gradient @ step > _SLOPE * jnp.maximum(-(step @ product(step)), 0.0)
    return jnp.where(uphill, -step, step)


def _lowest(
    product: Callable[[Array], Array], solve: Callable[[Array], Array], start: Float[Array, " n"]
) -> Float[Array, " n"]:
    """The lowest of v.Hv over v.Mv, where M is the matrix that `solve` solves with: of H alone it would be the shortest
    wave.

    ??? cite "Source"
        The locally optimal method of A. Knyazev, *Toward the optimal preconditioned eigensolver*, SIAM J. Sci. Comput.
        23 (2001) 517-541, for one vector.
    """
    # Vectors come with their products by H and by M, as rows; of what was solved for, the latter is known.
    images = lambda rhs: (lambda v: jnp.stack([v, product(v), rhs]))(solve(rhs))
    inner = lambda a, b: a[0] @ b[2]
    unit = lambda a: a / jnp.sqrt(jnp.maximum(jnp.abs(inner(a, a)), jnp.finfo(a.dtype).tiny))

    def improve(_, carry):
        vector, last = carry
        ahead = images(vector[1] - (vector[0] @ vector[1]) * vector[2])
        for other in (vector, last) * 2:
            ahead = unit(ahead - inner(other, ahead) * other)
        basis = jnp.stack([vector, ahead, last])
        curvature = basis[:, 0] @ basis[:, 1].T
        # An absent direction, of length zero, must not be the lowest.
        absent = jnp.diag(1 - jnp.array([1.0, 1.0, inner(last, last)]))
        curvature = (curvature + curvature.T) / 2 + 2 * jnp.linalg.norm(curvature) * absent
        lowest = jnp.linalg.eigh(curvature)[1][:, 0]
        along, off, further = jnp.where(lowest[0] < 0, -lowest, lowest)  # which has either sign
        # The step, made orthogonal to where it leads, is the third direction.
        size = jnp.hypot(off, further)
        safe = jnp.where(size > 0, size, 1.0)
        new = along * vector + off * ahead + further * last
        step = (along * (off * ahead + further * last) / safe - size * vector) * (size > 0)
        return new, step

    first = unit(images(solve(start)))
    return jax.lax.fori_loop(0, _LOBPCG_STEPS, improve, (first, jnp.zeros_like(first)))[0][0]
