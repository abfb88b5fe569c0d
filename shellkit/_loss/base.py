"""What a loss is, and how losses add and scale. A loss looks at an equilibrium and at the actuation that led to it;
it stands below the problem and knows nothing of how the equilibrium was found."""

import abc
from collections import Counter
from collections.abc import Iterable
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float, Scalar

from .._actuation.base import Actuation
from .._equilibrium import Equilibrium
from .._mesh.mesh import Mesh


class Loss(eqx.Module):
    """How far an equilibrium is from what is wanted.

    Losses add and scale: `VertexDistance(target) + 1e-3 * DirectorSmoothness()`. A loss of your own needs `__call__`
    only; a sum of squares is better written as a [`shellkit.LeastSquaresLoss`][], which second-order training can
    use. The other methods are answers that may be given more sharply: which shapes fit (`check`), whether a rigid
    motion changes the value (`sees_motion`), whether the relaxed shape is looked at (`needs_shape`).
    """

    papers: ClassVar[tuple[str, ...]] = ()
    """What to cite for it, as BibTeX; see [`shellkit.InverseProblem.citation`][]."""

    @abc.abstractmethod
    def __call__(self, equilibrium: Equilibrium, actuation: Actuation) -> Scalar:
        """The loss.

        **Arguments:**

        - `equilibrium`: what the relaxation returned: the mesh at rest, the actuated rest shape, the relaxed vertices.
        - `actuation`: what actuated it.

        **Returns:**

        A scalar.
        """

    def residuals(self, equilibrium: Equilibrium, actuation: Actuation) -> Float[Array, " m"] | None:
        """The numbers whose squares sum to the loss, or `None` if it is no sum of squares.

        **Arguments:**

        - `equilibrium`, `actuation`: as for calling the loss.

        **Returns:**

        An array of shape `(m,)`, or `None`.
        """
        return None

    def check(self, mesh: Mesh, actuation: Actuation) -> None:
        """Refuse a mesh or an actuation that this loss cannot be evaluated on.

        **Raises:**

        `ValueError`, with the shapes found and expected.
        """

    @property
    def sees_motion(self) -> bool:
        """Whether a rigid motion of the relaxed shape changes the loss. `True` if it is not known."""
        return True

    @property
    def needs_shape(self) -> bool:
        """Whether the relaxed shape is looked at. If no term of a loss does, nothing is relaxed."""
        return True

    @property
    def name(self) -> str:
        """The name the loss is reported under: that of its class."""
        return type(self).__name__

    def evaluate(self, equilibrium: Equilibrium, actuation: Actuation) -> tuple[Scalar, dict[str, Scalar]]:
        """The loss and what it is made of, each term computed once, sums and weights resolved.

        **Arguments:**

        - `equilibrium`, `actuation`: as for calling the loss.

        **Returns:**

        The total, and the unweighted value of each term by its name. A second term of a name is called
        `"Name 2"`, a third `"Name 3"`.
        """
        weights, losses = zip(*_parts(self), strict=True)
        values = [loss(equilibrium, actuation) for loss in losses]
        shares = [value if weight is None else weight * value for weight, value in zip(weights, values, strict=True)]
        return _total(shares), dict(zip(_distinct(loss.name for loss in losses), values, strict=True))

    def terms_without_residuals(self, equilibrium: Equilibrium, actuation: Actuation) -> list["Loss"]:
        """The terms of the loss that are no sums of squares; none of a loss that has `residuals`."""
        return [loss for _, loss in _parts(self) if loss.residuals(equilibrium, actuation) is None]

    def __add__(self, other: "Loss") -> "SumOfLosses":
        return SumOfLosses((self, other)) if isinstance(other, Loss) else NotImplemented

    def __radd__(self, other: object) -> "Loss":
        # `sum` begins with the integer 0.
        return self if isinstance(other, int) and other == 0 else NotImplemented

    def __mul__(self, weight: ArrayLike) -> "WeightedLoss":
        return NotImplemented if isinstance(weight, Loss) else WeightedLoss(self, weight)

    def __rmul__(self, weight: ArrayLike) -> "WeightedLoss":
        return self * weight


class LeastSquaresLoss(Loss):
    """A loss that is the sum of the squares of its [`shellkit.Loss.residuals`][]; a subclass gives these."""

    @abc.abstractmethod
    def residuals(self, equilibrium: Equilibrium, actuation: Actuation) -> Float[Array, " m"]:
        """The numbers whose squares sum to the loss.

        **Arguments:**

        - `equilibrium`, `actuation`: as for calling the loss.

        **Returns:**

        An array of shape `(m,)`.
        """

    def __call__(self, equilibrium: Equilibrium, actuation: Actuation) -> Scalar:
        return jnp.sum(self.residuals(equilibrium, actuation) ** 2)


class SumOfLosses(Loss):
    """The sum of losses, written `a + b`. Sums within sums are laid flat.

    **Arguments:**

    - `terms`: the losses.

    **Raises:** `ValueError` for none.
    """

    terms: tuple[Loss, ...]

    def __init__(self, terms: Iterable[Loss]):
        flat = [part for term in terms for part in (term.terms if isinstance(term, SumOfLosses) else (term,))]
        if not flat:
            raise ValueError("SumOfLosses: no terms; a sum needs at least one loss.")
        self.terms = tuple(flat)

    def __call__(self, equilibrium: Equilibrium, actuation: Actuation) -> Scalar:
        return _total([term(equilibrium, actuation) for term in self.terms])

    def residuals(self, equilibrium: Equilibrium, actuation: Actuation) -> Float[Array, " m"] | None:
        parts = [term.residuals(equilibrium, actuation) for term in self.terms]
        known = [part for part in parts if part is not None]
        return jnp.concatenate(known) if len(known) == len(parts) else None

    def check(self, mesh: Mesh, actuation: Actuation) -> None:
        for term in self.terms:
            term.check(mesh, actuation)

    @property
    def sees_motion(self) -> bool:
        return any(term.sees_motion for term in self.terms)

    @property
    def needs_shape(self) -> bool:
        return any(term.needs_shape for term in self.terms)


class WeightedLoss(Loss):
    """A loss times a number, written `weight * loss`. The weight is an array: changing it compiles nothing anew.

    **Arguments:**

    - `term`: the loss.
    - `weight`: a scalar, finite and not negative.

    **Raises:**

    `ValueError` for a weight that is not such a number.
    """

    term: Loss
    weight: Float[Array, ""]

    def __init__(self, term: Loss, weight: ArrayLike):
        self.term = term
        self.weight = jnp.asarray(weight, dtype=float)
        if self.weight.shape != ():
            raise ValueError(f"{term.name}: its weight has shape {self.weight.shape}; give one number, shape ().")
        if not isinstance(self.weight, Tracer):
            value = float(np.asarray(self.weight))
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(
                    f"{term.name}: its weight is {value}; a weight must be finite and not negative. Write what is to "
                    "be made large as a loss that is small there."
                )

    def __call__(self, equilibrium: Equilibrium, actuation: Actuation) -> Scalar:
        return self.weight * self.term(equilibrium, actuation)

    def residuals(self, equilibrium: Equilibrium, actuation: Actuation) -> Float[Array, " m"] | None:
        part = self.term.residuals(equilibrium, actuation)
        return None if part is None else jnp.sqrt(self.weight) * part

    def check(self, mesh: Mesh, actuation: Actuation) -> None:
        self.term.check(mesh, actuation)

    @property
    def sees_motion(self) -> bool:
        return self.term.sees_motion

    @property
    def needs_shape(self) -> bool:
        return self.term.needs_shape


def _parts(loss: Loss) -> list[tuple[Scalar | None, Loss]]:
    """What a loss is made of, down to terms that are neither sums nor weighted, each with its whole weight."""
    if isinstance(loss, SumOfLosses):
        return [part for term in loss.terms for part in _parts(term)]
    if isinstance(loss, WeightedLoss):
        return [(loss.weight if w is None else loss.weight * w, term) for w, term in _parts(loss.term)]
    return [(None, loss)]


def _total(values: list[Scalar]) -> Scalar:
    return jnp.sum(jnp.stack(values))


def _distinct(names: Iterable[str]) -> list[str]:
    seen: Counter[str] = Counter()
    distinct = []
    for name in names:
        seen[name] += 1
        distinct.append(name if seen[name] == 1 else f"{name} {seen[name]}")
    return distinct
