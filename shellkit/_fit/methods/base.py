"""How a fit gets from one design to the next: what the training loop asks of an optimiser, and the answer of optax's,
which follow the gradient."""

import abc
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..._programs.same import first_like
from ..design import Design
from ..history import Scalar
from ..step import Evaluation, advance, compile_ahead, evaluate, move, strong


class Course(NamedTuple):
    """Where a fit stands and where it goes next. `anchor` is the last accepted design, in the optimiser's variables,
    and `state` the optimiser's; what `update` and `scale` mean is up to the method."""

    anchor: dict[str, Array]
    update: dict[str, Array]
    scale: float
    state: Any


class Method(abc.ABC):
    """What the training loop asks of an optimiser."""

    @abc.abstractmethod
    def begin(self, design: Design, values: dict[str, Array]) -> Course:
        """The course before the first step, which goes nowhere."""

    @abc.abstractmethod
    def propose(self, course: Course) -> dict[str, Array]:
        """The design to be tried next."""

    @abc.abstractmethod
    def evaluate(self, design: Design, free: dict[str, Array], start: Any) -> Evaluation:
        """The loss of a design, and whatever else of it is needed to accept it."""

    @abc.abstractmethod
    def complete(self, design: Design, found: Evaluation, course: Course) -> tuple[Evaluation, Any]:
        """The evaluation of an accepted design with its gradient, and what `advance` needs to know besides."""

    @abc.abstractmethod
    def declines(self, course: Course, loss: float) -> bool:
        """Whether a sound design is turned down for its loss."""

    @abc.abstractmethod
    def refused(self, course: Course) -> Course:
        """The course after its proposal was refused."""

    @abc.abstractmethod
    def advance(self, design: Design, found: Evaluation, more: Any, course: Course, start: Any) -> Course:
        """The course from an accepted design, reached on `course`."""

    @abc.abstractmethod
    def arrived(self, course: Course) -> bool:
        """Whether the proposal is no further than the tolerance."""

    @abc.abstractmethod
    def columns(self, course: Course, more: Any) -> dict[str, Scalar]:
        """What the history records of it."""

    @abc.abstractmethod
    def choices(self) -> dict[str, str]:
        """What a checkpoint must agree with, beside the shapes of the state."""


class GradientMethod(Method):
    """The optimisers of optax. After a refusal the update is halved, and doubled back as designs are accepted."""

    def __init__(self, optimiser: Any):
        self._optimiser = first_like(optimiser)

    def begin(self, design: Design, values: dict[str, Array]) -> Course:
        free = strong(design.free(values))
        compile_ahead(design, free)
        return Course(free, jax.tree.map(jnp.zeros_like, free), 1.0, strong(self._optimiser.init(free)))

    def propose(self, course: Course) -> dict[str, Array]:
        return move(course.anchor, course.update, jnp.asarray(np.float64(course.scale)))

    def evaluate(self, design: Design, free: dict[str, Array], start: Any) -> Evaluation:
        return evaluate(design, free, start)

    def complete(self, design: Design, found: Evaluation, course: Course) -> tuple[Evaluation, None]:
        return found, None

    def declines(self, course: Course, loss: float) -> bool:
        return False

    def refused(self, course: Course) -> Course:
        return course._replace(scale=course.scale / 2)

    def advance(self, design: Design, found: Evaluation, more: None, course: Course, start: Any) -> Course:
        assert found.gradient is not None
        at = (found.free, found.loss, found.gradient)
        update, state = advance(self._optimiser, design, at, course.state, start)
        return Course(found.free, update, min(1.0, 2 * course.scale), state)

    def arrived(self, course: Course) -> bool:
        return False

    def columns(self, course: Course, more: None) -> dict[str, Scalar]:
        return {"update_scale": course.scale}

    def choices(self) -> dict[str, str]:
        return {}
