"""What the training loop asks of a method, and the records that they hand to each other."""

import abc
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
from jaxtyping import Array

from ..design import Design
from ..history import Scalar
from ..step import Evaluation


class Course(NamedTuple):
    """Where a fit stands and where it goes next: the design to be tried is `anchor + scale * update`.

    **Attributes:**

    - `anchor`: the last accepted design: the trained arrays by name, in the optimiser's variables (they differ from the
        arrays themselves where these are bounded).
    - `update`: the step from there, of the same shapes.
    - `scale`: the part of it to be taken.
    - `state`: whatever the method remembers, a pytree of arrays. Checkpoints keep it.
    """

    anchor: dict[str, Array]
    update: dict[str, Array]
    scale: float | Array
    state: Any


class Accepted(NamedTuple):
    """The answer of a method that accepts a design.

    **Attributes:**

    - `found`: what was found there.
    - `state`: what the method remembers from now on.
    - `columns`: numbers for the row of the history, by name; the same names at each step.
    """

    found: Evaluation
    state: Any
    columns: dict[str, Scalar]


class Objective(eqx.Module):
    """What is minimised, for methods that look elsewhere than at the designs which the loop evaluates for them.

    **Attributes:**

    - `design`: the problem without its trained arrays.
    - `start`: the equilibrium from which relaxations begin in a fit with warm starts; `None`: from rest.
    - `rise`: the part of itself by which the loss may rise in a step; `None`: what the method itself allows.
    """

    design: Design
    start: Any = None
    rise: float | None = None

    def problem(self, variables: dict[str, Array]) -> Any:
        """The problem at some values of the optimiser's variables.

        **Arguments:**

        - `variables`: arrays by name, as `Course.anchor`.
        """
        return self.design.problem(self.design.values(variables))


class Method(eqx.Module):
    """A way to train: what [`shellkit.fit`][] asks of it. Two methods have to be written, `init` and `update`.

    The loop proposes the design `anchor + scale * update` of a [`shellkit.Course`][], relaxes it, and refuses it if its
    loss or gradient is not finite or its relaxation failed. Otherwise the method may `accept` it, and `update` says
    where to go from there. Nothing is kept between these calls but what they return; numbers of a method, such as a
    rate, are its fields. History, checkpoints, warm starts and refusals work with any method. A checkpoint belongs to a
    method of the same class with a state of the same shapes; it does not compare the fields.

    `needs_gradient` is a class variable: `False` where the loss alone is looked at, which is then all that is worked
    out at a design. A class may answer `accept`, `refuse`, `arrived` and `name` in its own way; the others, and those
    as they are here, suit a method that follows the gradient.

    When not to use it: an optimiser of optax, also one of your own made with its parts, is passed to `fit` as it is.

    ??? example

        ```python
        class HeavyBall(sk.Method):
            rate: float
            momentum: float = 0.9

            def init(self, objective, variables):
                return jax.tree.map(jnp.zeros_like, variables)

            def update(self, objective, found, state):
                velocity = jax.tree.map(lambda v, g: self.momentum * v - self.rate * g, state, found.gradient)
                return velocity, velocity
        ```
    """

    needs_gradient: ClassVar[bool] = True

    @abc.abstractmethod
    def init(self, objective: Objective, variables: dict[str, Array]) -> Any:
        """The state before the first step, a pytree of arrays.

        **Arguments:**

        - `objective`: what is to be minimised.
        - `variables`: the start, arrays by name.
        """

    @abc.abstractmethod
    def update(self, objective: Objective, found: Evaluation, state: Any) -> tuple[dict[str, Array], Any]:
        """The step from an accepted design, and the next state.

        **Arguments:**

        - `objective`: what is minimised.
        - `found`: what was found at the design; its gradient is finite.
        - `state`: the state that `accept` returned.
        """

    def accept(self, objective: Objective, found: Evaluation, course: Course) -> Accepted | None:
        """Whether to go on from a sound design: its evaluation, completed where the loop needs more to be known, the
        state and what to record; or `None`, and `refuse` is asked where else to go.

        **Arguments:**

        - `objective`: what is minimised.
        - `found`: what was found at the design.
        - `course`: the course that proposed it.
        """
        return Accepted(found, course.state, {"update_scale": float(course.scale)})

    def refuse(self, course: Course) -> Course:
        """The course after the design that it proposed was refused: half of the step, which grows back with designs
        that are accepted. It must go on from `course.anchor`.

        **Arguments:**

        - `course`: the course that was refused.
        """
        return course._replace(scale=course.scale / 2)

    def arrived(self, course: Course) -> bool:
        """Whether the step is below the tolerance of the method, which ends the fit.

        **Arguments:**

        - `course`: the course that would be tried next.
        """
        return False

    @property
    def name(self) -> str | None:
        """What a checkpoint calls the method: the name of its class."""
        return type(self).__name__
