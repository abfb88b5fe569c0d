"""How far to go in the model of a sum of squares: the rules of Levenberg and Marquardt, of Gauss and Newton, and of
Powell. Each is one number that a refused step tightens and a good one loosens."""

import abc

import equinox as eqx
import numpy as np

from .gauss_newton import Model


_NEGLIGIBLE = 1e-10  # relative size below which a singular value is taken as zero by the rules that divide by it
_LARGEST_REFUSAL = 2.0**10


class Rule(eqx.Module):
    """The coefficients of the step in a model, and how its `control` changes. `streak` counts refusals in a row."""

    @abc.abstractmethod
    def begin(self, model: Model) -> float:
        """The control before the first step."""

    @abc.abstractmethod
    def step(self, model: Model, control: float) -> np.ndarray:
        """The coefficients of the step on the directions of the model, shape (k,)."""

    @abc.abstractmethod
    def refused(self, control: float, length: float, streak: int) -> float:
        """The control after a step of this length was refused."""

    @abc.abstractmethod
    def accepted(self, control: float, length: float, gain: float) -> float:
        """The control after a step that gained this part of what the model promised."""

    @abc.abstractmethod
    def damping(self, control: float) -> float:
        """The damping for which the next model should be accurate."""


class NielsenDamping(Rule):
    r"""The damping $\mu$ of [`shellkit.LevenbergMarquardt`][], whose step along the singular vectors of the Jacobian is
    $a_i = \sigma_i c_i / (\sigma_i^2 + \mu)$.

    After an accepted step, with $g$ the part of the promised decrease that came true, $\mu$ is multiplied with
    $1 - (2 g - 1)^3$ within limits; after $k$ refusals in a row with $2^k$.

    **Arguments:**

    - `first`: the damping of the first step, in units of the largest eigenvalue of $J^T J$.
    - `decay`: the least factor after a step, in (0, 1].
    - `growth`: the largest factor after a step, at least 1; it is used where the loss rose, if the fit allows that.

    **Raises:** `ValueError` for numbers out of range.

    ??? cite "Source"
        H. B. Nielsen, *Damping parameter in Marquardt's method*, IMM-REP-1999-05 (1999), equation (2.5).
    """

    first: float = 1e-3
    decay: float = 0.1
    growth: float = 2.0

    def __check_init__(self):
        if not self.first > 0:
            raise ValueError(f"NielsenDamping: first must be positive; got {self.first}.")
        if not 0 < self.decay <= 1 <= self.growth:
            raise ValueError(
                f"NielsenDamping: decay must be in (0, 1] and growth at least 1; got {self.decay} and {self.growth}."
            )

    def begin(self, model: Model) -> float:
        return self.first * float(np.max(np.asarray(model.singular), initial=0.0)) ** 2

    def step(self, model: Model, control: float) -> np.ndarray:
        singular, along = np.asarray(model.singular), np.asarray(model.along)
        with np.errstate(invalid="ignore"):
            return np.nan_to_num(singular * along / (singular**2 + control))

    def refused(self, control: float, length: float, streak: int) -> float:
        return control * min(2.0**streak, _LARGEST_REFUSAL)

    def accepted(self, control: float, length: float, gain: float) -> float:
        return control * min(self.growth, max(self.decay, 1 - (2 * gain - 1) ** 3))

    def damping(self, control: float) -> float:
        return control


class StepHalving(Rule):
    """Gauss and Newton: the least-squares step, the control being the part of it that is taken, one unless refused."""

    def begin(self, model: Model) -> float:
        return 1.0

    def step(self, model: Model, control: float) -> np.ndarray:
        return control * _newton(model)

    def refused(self, control: float, length: float, streak: int) -> float:
        return control / 2

    def accepted(self, control: float, length: float, gain: float) -> float:
        return control if gain < 0 else min(1.0, 2 * control)

    def damping(self, control: float) -> float:
        return 0.0


class DoglegRadius(Rule):
    """Powell's dogleg: from the minimum along the gradient towards the least-squares step, up to a length, the control.

    ??? cite "Source"
        J. Nocedal, S. Wright, *Numerical Optimization*, 2nd edition (2006), section 4.1 and algorithm 4.1.
    """

    def begin(self, model: Model) -> float:
        return 10 * float(np.linalg.norm(_cauchy(model)))

    def step(self, model: Model, control: float) -> np.ndarray:
        newton, cauchy = _newton(model), _cauchy(model)
        if np.linalg.norm(newton) <= control:
            return newton
        size = np.linalg.norm(cauchy)
        if size >= control:
            return control / size * cauchy
        # The positive root of |cauchy + t (newton - cauchy)| = control.
        turn = newton - cauchy
        a, b, c = turn @ turn, cauchy @ turn, size**2 - control**2
        return cauchy + (np.sqrt(b**2 - a * c) - b) / a * turn

    def refused(self, control: float, length: float, streak: int) -> float:
        return length / 4

    def accepted(self, control: float, length: float, gain: float) -> float:
        if gain < 0.25:
            return length / 4
        return 3 * control if gain > 0.75 and length > 0.99 * control else control

    def damping(self, control: float) -> float:
        return 0.0


def _newton(model: Model) -> np.ndarray:
    singular, along = np.asarray(model.singular), np.asarray(model.along)
    counted = singular > _NEGLIGIBLE * np.max(singular, initial=0.0)
    return np.where(counted, along / np.where(counted, singular, 1), 0.0)


def _cauchy(model: Model) -> np.ndarray:
    singular = np.asarray(model.singular)
    downhill = singular * np.asarray(model.along)
    curvature = np.sum((singular * downhill) ** 2)
    return downhill * (downhill @ downhill / curvature if curvature > 0 else 0.0)
