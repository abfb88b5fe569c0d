"""The shift that makes a Hessian positive definite far from a minimum."""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Scalar

from ..._citation.papers import GILL_1981, NOCEDAL_2006, TERAN_2005
from ..matrices.operator import SparseSymmetric
from .model import AnyFactor, Factorised, KeptFactor, QuadraticModel, positive_definite, restored
from .objective import Convexification, Hessian
from .points import Reached, Step


class Shift(eqx.Module):
    r"""What is added to a Hessian until the inertia of its factor shows no negative eigenvalue.

    A part $\sigma / (\sigma + \sigma_{1/2})$ of what makes the energy convex element by element, and a small multiple
    of the identity; or, where nothing is known to make it convex, $\sigma$ times the identity. The shift $\sigma$, in
    units of the mean diagonal entry, is raised within a step as often as needed, grows where the model promised more
    than there was, and falls to zero near a minimum.

    Compressed shells have negative eigenvalues far beyond the first one to buckle. With a multiple of the identity the
    last of them, of short waves, becomes the softest direction that is left, and leads to crumpled states; a convex
    model keeps the order of the modes.

    Not of use with a linear solver that cannot tell the inertia.

    ??? cite "Source"
        Algorithm 3.3 of J. Nocedal and S. Wright, *Numerical Optimization*, 2nd edition (2006), with a factorisation
        that reports the inertia (section 3.4). What makes the Hessian of a shell convex is a modified Cholesky
        factorisation of P. Gill, W. Murray and M. Wright, *Practical Optimization* (1981), section 4.4.2.2, face by
        face; elements of other energies keep the positive part of theirs, as in J. Teran, E. Sifakis, G. Irving and R.
        Fedkiw, *Robust quasistatic finite elements and flesh simulation*, Proc. ACM SIGGRAPH/Eurographics Symposium on
        Computer Animation (2005), 181–190.

    **Arguments:**

    - `smallest`, `largest`: the first shift that is tried, and that beyond which the search gives up.
    - `growth`: the factor by which a shift that is too small grows; tries within a step lie ever further apart.
    - `decay`: the factor by which a shift that was enough falls from one step to the next.
    - `half_convex`: the shift $\sigma_{1/2}$ at which the model is half convex.
    - `damping`: the part of the identity in a convex model.
    - `near`: a step below this fraction of the typical length, whose shift was enough at once, needs none next time.
    - `max_tries`: the most factorisations in a step.
    - `first_stride`: how many powers of `growth` lie between the tries of the very first step, at least.
    """

    papers: ClassVar[tuple[str, ...]] = (NOCEDAL_2006, GILL_1981, TERAN_2005)
    smallest: float = eqx.field(static=True, default=1e-4)
    largest: float = eqx.field(static=True, default=1e8)
    growth: float = eqx.field(static=True, default=4.0)
    decay: float = eqx.field(static=True, default=0.1)
    half_convex: float = eqx.field(static=True, default=1e-3)
    damping: float = eqx.field(static=True, default=1e-6)
    near: float = eqx.field(static=True, default=1e-2)
    max_tries: int = eqx.field(static=True, default=8)
    first_stride: int = eqx.field(static=True, default=3)

    def factorise(
        self,
        linear_solver: Any,
        hessian: Hessian,
        convexification: Convexification | None,
        rhs: Float[Array, " n"],
        unit: Scalar,
        last: KeptFactor,
        shift: Scalar,
        first: Bool[Array, ""],
        once: Bool[Array, ""],
    ) -> Factorised:
        """The factor of the Hessian with the smallest shift tried, from the given one up, that leaves no negative
        eigenvalue; or the last one tried.

        **Arguments:**

        - `linear_solver`: of matrices like the Hessian.
        - `hessian`, `convexification`: the matrix, and what makes it positive semidefinite.
        - `rhs`: to solve for.
        - `unit`: of the shift: the mean size of the diagonal entries.
        - `last`: any factor, for its structure.
        - `shift`: with which to begin.
        - `first`: whether this is the first step of all.
        - `once`: whether one try must do.
        """

        def attempt(now: _Try) -> _Try:
            if convexification is None:
                convexity, matrix = None, hessian.shifted(now.next_shift * unit)
            else:
                # Worked out at the first shift of this step.
                wanted = (now.next_shift > 0) & ((now.tries == 0) | (now.shift == 0))
                make = convexification
                convexity = jax.lax.cond(wanted, lambda: make().values, lambda: now.convexity)
                matrix = self.convexified(hessian, convexity, now.next_shift, unit)
            factor, solution = linear_solver.factorise_and_solve(matrix, rhs)
            # A try costs as much as a step: they lie ever further apart, at first too, where the way is long.
            stride = now.tries + jnp.where(first, self.first_stride, 1)
            higher = jnp.maximum(now.next_shift, self.smallest) * self.growth ** stride.astype(float)
            return _Try(factor, solution, higher, now.next_shift, now.tries + 1, convexity)

        def unfit(now: _Try) -> Bool[Array, ""]:
            return (now.tries == 0) | (~positive_definite(now.factor) & (now.tries < max_tries))

        max_tries = jnp.where(once, 1, self.max_tries)
        sparse = hessian if isinstance(hessian, SparseSymmetric) else hessian.sparse
        convexity = None if convexification is None else jnp.zeros_like(sparse.values)
        start = _Try(restored(last, hessian), rhs, shift, shift, jnp.zeros((), jnp.int32), convexity)
        end = jax.lax.while_loop(unfit, attempt, start)
        return Factorised(end.factor, end.solution, end.shift, end.tries)

    def convexified(self, hessian: Hessian, convexity: Float[Array, " nnz"], shift: Scalar, unit: Scalar) -> Hessian:
        """The Hessian with a part of what makes it convex, all of it as the shift grows.

        **Arguments:**

        - `hessian`: the matrix, of shape (n, n).
        - `convexity`: the values of what makes it convex, on the same pattern.
        - `shift`, `unit`: the shift, and the mean size of the diagonal entries.
        """
        part = shift / (shift + self.half_convex)
        # What other terms may have of negative curvature is left to the identity, once nothing else helps.
        damping = self.damping * shift * (1 + shift) ** 2 * unit
        return hessian.plus(part * convexity).shifted(damping)

    def after(
        self,
        model: QuadraticModel,
        step: Step,
        reached: Reached,
        distrusted: Bool[Array, ""],
        lost: Bool[Array, ""],
        unit: Scalar,
    ) -> Scalar:
        """The shift to begin the next step with.

        **Arguments:**

        - `model`, `step`, `reached`: of the step that was taken, and where it led.
        - `distrusted`: whether the step had to be cut short.
        - `lost`: whether nothing of it could be taken.
        - `unit`: the typical length.
        """
        grown = jnp.maximum(model.shift, self.smallest) * self.growth
        # A shift that had to be raised within the step is kept; one that was enough at once fades fast.
        decayed = model.shift * jnp.where(model.tries > 1, 1.0, self.decay)
        needless = (decayed < self.smallest) | ((step.size < self.near * unit) & (model.tries == 1))
        faded = jnp.where(needless, 0.0, decayed)
        trusted = reached.length > 0.5
        adapted = jnp.where(distrusted, grown, jnp.where(trusted, faded, model.shift))
        kept = jnp.where(step.escaping & reached.stalled, model.shift, adapted)
        return jnp.where(lost, grown * self.growth, kept)


class _Try(eqx.Module):
    """A factorisation with one shift, and the shift to try next."""

    factor: AnyFactor
    solution: Float[Array, " n"]
    next_shift: Scalar
    shift: Scalar
    tries: Int[Array, ""]
    convexity: Float[Array, " nnz"] | None
