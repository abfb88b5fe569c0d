"""Alignment of point sets of different size, by the nearest points of a target. The pose is found without derivatives;
its derivative is that of a minimum, by the implicit function theorem."""

from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float, Int, Scalar

from .._citation.papers import BESL_1992, POTTMANN_2006
from .._geometry.closest import closest_points, nearest_points, normal_projections
from .aligners import Aligner, Motion, NoAlignment


_DAMPING = 1e-3  # of the first step, relative to the mean curvature of the objective
_FLAT = 1e-9  # directions in which the objective curves less than this part of the most are left alone
_ROUNDING = 1e-12  # relative changes of the misfit that say nothing
_NOTHING_GAINED = 1e-8  # length of a step that gains nothing, after which none is tried
_SETTLED = 1e-12  # length of the step, relative to the size of the points, at which the pose is taken as found


class ICP(Aligner):
    r"""The rigid motion that brings points nearest to a target of other points, or to a surface.

    Minimises $\sum_i |y_i - P(y_i)|^2$ over the motions $y = (x - o) R + o'$, with $P$ the nearest point of the target.
    It finds the minimum next to where it starts, by damped Newton steps on the squared distances themselves, which
    takes fewer steps than the classical exchange of correspondences and rotations. The points' own pose, or that of
    the aligner `start`, should be within about a quarter of a turn.

    The derivative is that of the minimum (implicit function theorem): exact, but for places where a nearest point
    jumps; where the target can turn in itself, as a sphere, it is the smallest one that is consistent. Second
    derivatives leave out how the objective's curvature changes.

    **Arguments:**

    - `faces`: those of the target, shape `(F, 3)`, so that it is a surface; left out, it is a set of points.
    - `start`: the aligner that gives the first pose, such as [`shellkit.Landmarks`][]; by default the points stay.
    - `max_steps`: how many steps at most.

    **Raises:**

    `ValueError` for faces of another shape, or beyond the target when called.

    ??? cite

        P. J. Besl and N. D. McKay, "A method for registration of 3-D shapes", IEEE Transactions on Pattern Analysis
        and Machine Intelligence 14 (1992), 239; the steps are those of H. Pottmann, Q.-X. Huang, Y.-L. Yang and S.-M.
        Hu, "Geometry and convergence analysis of algorithms for registration of 3D shapes", International Journal of
        Computer Vision 67 (2006), 277.
    """

    papers: ClassVar[tuple[str, ...]] = (BESL_1992, POTTMANN_2006)

    faces: Int[Array, "F 3"] | None
    start: Aligner
    max_steps: int = eqx.field(static=True)

    def __init__(self, faces: ArrayLike | Sequence | None = None, start: Aligner = NoAlignment(), max_steps: int = 50):
        self.faces = None if faces is None else _checked_faces(faces)
        self.start = start
        self.max_steps = max_steps

    @property
    def removes_motion(self) -> bool:
        return self.start.removes_motion

    def motion(self, points: Float[Array, "n 3"], target: Float[Array, "m 3"]) -> Motion:
        if self.faces is not None and not isinstance(self.faces, Tracer):
            last = int(np.max(np.asarray(self.faces)))
            if last >= target.shape[0]:
                raise ValueError(
                    f"ICP: its faces have corner {last}, but the target has {target.shape[0]} points; give the faces "
                    "of the target's mesh."
                )
        return _best_motion(self, points, target)


@eqx.filter_jit
def _best_motion(icp: ICP, points: Array, target: Array) -> Motion:
    """The motion of the minimum, with the derivative of a minimum."""
    still, still_target = jax.lax.stop_gradient((points, target))
    found = _search(icp, still, still_target)
    size = _size(still)
    curvature = _look(found(still), still_target, icp.faces, found.onto, size).curvature
    placed = found(points)
    here = _slope(_apart(placed, target, icp.faces)[0], placed - found.onto, size)
    # Zero at the minimum, as a value: what remains is how it moves with the points.
    turn = -_pseudo_inverse(curvature) @ (here - jax.lax.stop_gradient(here))
    rotation, shift = _small_motion(turn, size)
    return Motion(found.rotation @ rotation, found.origin, found.onto + shift)


class _Seen(NamedTuple):
    """Half the mean squared distance at a pose, and its derivatives in a small turn and shift from there."""

    misfit: Scalar
    slope: Float[Array, " 6"]
    curvature: Float[Array, "6 6"]


def _search(icp: ICP, points: Array, target: Array) -> Motion:
    """The motion of the minimum, by Newton steps with Levenberg's damping; a step that does not lower the misfit is
    taken back and damped more."""
    first = icp.start.motion(points, target)
    origin, size = jnp.mean(points, axis=0), _size(points)
    if first is None:
        rotation, onto = jnp.eye(3, dtype=points.dtype), origin
    else:
        rotation, onto = first.rotation, first(origin[None])[0]

    def look(rotation, onto):
        return _look(Motion(rotation, origin, onto)(points), target, icp.faces, onto, size)

    def step(state):
        number, rotation, onto, damping, seen, _ = state
        values, vectors = jnp.linalg.eigh(seen.curvature)
        stiffness = jnp.abs(values) + damping * jnp.max(jnp.abs(values))
        turn = -vectors @ ((vectors.T @ seen.slope) / jnp.where(stiffness > 0, stiffness, 1.0))
        turn = turn / jnp.maximum(1.0, 2 * jnp.linalg.norm(turn))
        more, shift = _small_motion(turn, size, exact=True)
        tried = (rotation @ more, onto + shift)
        there = look(*tried)
        # Where rounding hides what a step gains, a smaller slope tells that it came nearer.
        same = jnp.abs(there.misfit - seen.misfit) <= _ROUNDING * seen.misfit
        smaller = jnp.linalg.norm(there.slope) < jnp.linalg.norm(seen.slope)
        better = jnp.where(same, smaller, there.misfit < seen.misfit)
        rotation, onto, seen = jax.tree.map(
            lambda new, old: jnp.where(better, new, old), (*tried, there), (rotation, onto, seen)
        )
        settled = jnp.linalg.norm(turn) < jnp.where(better, _SETTLED, _NOTHING_GAINED)
        return number + 1, rotation, onto, jnp.where(better, 0.1, 10.0) * damping, seen, settled

    def goes_on(state):
        return (state[0] < icp.max_steps) & ~state[-1]

    begin = (0, rotation, onto, jnp.asarray(_DAMPING, points.dtype), look(rotation, onto), jnp.asarray(False))
    _, rotation, onto, *_ = jax.lax.while_loop(goes_on, step, begin)
    return Motion(rotation, origin, onto)


def _look(placed, target, faces, centre, size) -> _Seen:
    """By hand: the difference from the nearest point changes as that to the plane, line or point it lies on."""
    apart, normal_part = _apart(placed, target, faces)
    arms = (placed - centre) / size
    zero = jnp.zeros_like(arms[:, 0])
    x, y, z = arms.T
    # Row i of `turned` is how point i moves under a turn about axis i, y = arm x axis, in units of the size.
    turned = jnp.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=1).reshape(-1, 3, 3)
    moved = size * jnp.concatenate([turned, jnp.broadcast_to(jnp.eye(3, dtype=arms.dtype), turned.shape)], axis=1)
    curvature = jnp.einsum("nai,nij,nbj->ab", moved, normal_part, moved) / arms.shape[0]
    # The second order of a turn: (arm x w) x w / 2.
    lever = size * (apart.T @ arms) / arms.shape[0]
    bent = (lever + lever.T) / 2 - jnp.trace(lever) * jnp.eye(3, dtype=arms.dtype)
    misfit = jnp.mean(jnp.sum(apart**2, axis=1)) / 2
    return _Seen(misfit, _slope(apart, placed - centre, size), curvature.at[:3, :3].add(bent))


def _slope(apart, arms, size):
    """The derivative of half the mean squared distance in a small turn and a small shift."""
    return jnp.concatenate([jnp.mean(jnp.cross(apart, arms), axis=0), size * jnp.mean(apart, axis=0)])


def _apart(placed, target, faces):
    """Differences from the nearest points, and their derivatives in the points."""
    if faces is None:
        apart = placed - target[nearest_points(placed, target)]
        return apart, jnp.broadcast_to(jnp.eye(3, dtype=apart.dtype), (apart.shape[0], 3, 3))
    closest = closest_points(placed, target, faces)
    return placed - closest.points, normal_projections(closest, target, faces)


def _small_motion(turn, size, exact=False):
    """A rotation and a shift from six numbers without unit: to second order, or a rotation to the last digit."""
    zero = jnp.zeros((), turn.dtype)
    a, b, c = turn[0], turn[1], turn[2]
    spin = jnp.stack([zero, -c, b, c, zero, -a, -b, a, zero]).reshape(3, 3)
    if exact:
        # Cayley's transform, which agrees to second order with what the slope and the curvature are taken of.
        eye = jnp.eye(3, dtype=turn.dtype)
        return jnp.linalg.solve(eye - spin / 2, eye + spin / 2), size * turn[3:]
    return jnp.eye(3, dtype=turn.dtype) + spin + spin @ spin / 2, size * turn[3:]


def _size(points):
    """Root mean square distance of points from their mean, so that turns and shifts are told by like numbers."""
    spread = jnp.mean(jnp.sum((points - jnp.mean(points, axis=0)) ** 2, axis=1))
    return jnp.where(spread > 0, jnp.sqrt(jnp.where(spread > 0, spread, 1.0)), 1.0)


def _pseudo_inverse(curvature):
    values, vectors = jnp.linalg.eigh((curvature + curvature.T) / 2)
    stiff = values > _FLAT * jnp.max(values)
    return (vectors * jnp.where(stiff, 1 / jnp.where(stiff, values, 1.0), 0.0)) @ vectors.T


def _checked_faces(faces: ArrayLike | Sequence) -> Int[Array, "F 3"]:
    faces = jnp.asarray(faces)
    if faces.ndim != 2 or faces.shape[1] != 3 or not jnp.issubdtype(faces.dtype, jnp.integer):
        raise ValueError(
            f"ICP: faces has shape {faces.shape} and type {faces.dtype}; give the target's triangles, as in "
            "ICP(target.faces), shape (F, 3)."
        )
    return faces
