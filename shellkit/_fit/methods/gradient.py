"""The optimisers of optax as a method of the training loop. After a refusal the update is halved, and doubled back as
designs are accepted."""

from typing import Any

import equinox as eqx
from jaxtyping import Array

from ..._programs.same import first_like
from ..step import Evaluation, advance
from .base import Method, Objective


class GradientMethod(Method):
    """An optimiser of optax, whatever its state."""

    optimiser: Any = eqx.field(converter=first_like)

    def init(self, objective: Objective, variables: dict[str, Array]) -> Any:
        return self.optimiser.init(variables)

    def update(self, objective: Objective, found: Evaluation, state: Any) -> tuple[dict[str, Array], Any]:
        assert found.gradient is not None
        at = (found.free, found.loss, found.gradient)
        return advance(self.optimiser, objective.design, at, state, objective.start)

    @property
    def name(self) -> None:
        """Optax's functions have none; their state tells them apart."""
