"""Aligners: the motion that lays one point set upon another, and its exact derivative. The rotation comes from a
singular value decomposition; its derivative does not, since the decomposition's is singular at equal singular
values."""

import abc
from collections.abc import Sequence
from typing import ClassVar, overload

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float, Int, Scalar

from .._citation.papers import KABSCH_1976, UMEYAMA_1991
from .._mesh.mesh import Mesh


class Motion(eqx.Module):
    r"""A rotation about a point, a uniform scaling and a shift.

    $x \mapsto s\,(x - o) R + o'$, for points $x$ as rows.
    """

    rotation: Float[Array, "3 3"]
    """$R$, whose determinant is one."""
    origin: Float[Array, " 3"]
    """$o$, the point about which is turned and scaled, in the unit of the points."""
    onto: Float[Array, " 3"]
    """$o'$, where that point goes."""
    scale: Scalar | None = None
    """$s$; `None` is one."""

    @overload
    def __call__(self, points: Mesh) -> Mesh: ...

    @overload
    def __call__(self, points: Float[Array, "n 3"]) -> Float[Array, "n 3"]: ...

    def __call__(self, points: Float[Array, "n 3"] | Mesh) -> Float[Array, "n 3"] | Mesh:
        """Move points, given as rows, or a mesh.

        **Arguments:**

        - `points`: shape `(n, 3)`; any points, not only those the motion was found on. Or a [`shellkit.Mesh`][].

        **Returns:**

        The moved points, shape `(n, 3)`, or the moved mesh.
        """
        if isinstance(points, Mesh):
            return points.with_vertices(self(points.vertices))
        turned = (points - self.origin) @ self.rotation
        return self.onto + (turned if self.scale is None else self.scale * turned)


class Aligner(eqx.Module):
    """Moves one point set onto another.

    A subclass gives [`shellkit.Aligner.motion`][]; calling the aligner applies that motion. Gradients flow through
    the motion, with respect to both point sets, forwards, backwards and to any order.
    """

    papers: ClassVar[tuple[str, ...]] = ()
    """What to cite for it, as BibTeX; see [`shellkit.InverseProblem.citation`][]."""

    @property
    @abc.abstractmethod
    def removes_motion(self) -> bool:
        """Whether the moved points stay the same when the points are rotated and shifted beforehand."""

    @abc.abstractmethod
    def motion(self, points: Float[Array, "n 3"], target: Float[Array, "m 3"]) -> Motion | None:
        """Find the motion that lays `points` upon `target`.

        **Arguments:**

        - `points`: the points to be moved, shape `(n, 3)`.
        - `target`: where they should go, shape `(m, 3)`.

        **Returns:**

        The motion, or `None` if nothing is to be moved.
        """

    def __call__(self, points: Float[Array, "n 3"], target: Float[Array, "m 3"]) -> Float[Array, "n 3"]:
        """Lay `points` upon `target`.

        **Arguments:**

        - `points`: the points to be moved, shape `(n, 3)`.
        - `target`: where they should go, shape `(m, 3)`; row by row, except where the aligner says otherwise.

        **Returns:**

        The moved points, shape `(n, 3)`.
        """
        motion = self.motion(points, target)
        return points if motion is None else motion(points)


class Kabsch(Aligner):
    """The rigid motion with the smallest (weighted) sum of squared distances.

    Only proper rotations: mirrored sets are turned, never reflected. Planar sets are aligned as any other. Where the
    best rotation is not unique (collinear points; the mirror image of a set without a preferred axis) one of the best
    is chosen, and its derivative is the smallest one that is consistent: finite always.

    **Arguments:**

    - `weights`: one per point, shape `(n,)`, not negative; all equal if left out.

    **Raises:**

    `ValueError` for weights that are negative, not finite, all zero or not one per point.

    ??? cite

        W. Kabsch, "A solution for the best rotation to relate two sets of vectors", Acta Crystallographica A 32
        (1976), 922.

        ```bibtex
        @article{kabsch1976solution,
            author = {Kabsch, Wolfgang},
            title = {A solution for the best rotation to relate two sets of vectors},
            journal = {Acta Crystallographica Section A},
            volume = {32},
            number = {5},
            pages = {922--923},
            year = {1976},
        }
        ```
    """

    papers: ClassVar[tuple[str, ...]] = (KABSCH_1976,)
    weights: Float[Array, " n"] | None

    def __init__(self, weights: ArrayLike | Sequence | None = None):
        self.weights = None if weights is None else checked_weights("Kabsch", weights)

    @property
    def removes_motion(self) -> bool:
        return True

    def motion(self, points: Float[Array, "n 3"], target: Float[Array, "m 3"]) -> Motion:
        return _best_motion("Kabsch", points, target, self.weights, scaled=False)


class Similarity(Aligner):
    """The rigid motion and uniform scaling with the smallest (weighted) sum of squared distances.

    Umeyama (1991), equations (40) to (42). Use it when only the form counts, not the size: points that all coincide
    with their mean stay there, whatever the target.

    **Arguments:**

    - `weights`: one per point, shape `(n,)`, not negative; all equal if left out.

    **Raises:**

    `ValueError` for weights that are negative, not finite, all zero or not one per point.

    ??? cite

        ```bibtex
        @article{umeyama1991least,
            author = {Umeyama, Shinji},
            title = {Least-squares estimation of transformation parameters between two point patterns},
            journal = {IEEE Transactions on Pattern Analysis and Machine Intelligence},
            volume = {13},
            number = {4},
            pages = {376--380},
            year = {1991},
        }
        ```
    """

    papers: ClassVar[tuple[str, ...]] = (UMEYAMA_1991,)
    weights: Float[Array, " n"] | None

    def __init__(self, weights: ArrayLike | Sequence | None = None):
        self.weights = None if weights is None else checked_weights("Similarity", weights)

    @property
    def removes_motion(self) -> bool:
        return True

    def motion(self, points: Float[Array, "n 3"], target: Float[Array, "m 3"]) -> Motion:
        return _best_motion("Similarity", points, target, self.weights, scaled=True)


class Landmarks(Aligner):
    """Finds the motion on a few marked points and applies it to all.

    **Arguments:**

    - `indices`: the marked points, shape `(k,)`, at least three of them and not on a line, or the rotation is not
        determined.
    - `target_indices`: their partners in the target, shape `(k,)`; the same indices if left out. With it, the two
        point sets may differ in size.
    - `aligner`: how the marked points are laid upon their partners.

    **Raises:**

    `ValueError` for fewer than three landmarks, indices outside the point set, or partners of another number.
    """

    indices: Int[Array, " k"]
    target_indices: Int[Array, " k"] | None
    aligner: Aligner

    def __init__(
        self,
        indices: ArrayLike | Sequence,
        target_indices: ArrayLike | Sequence | None = None,
        aligner: Aligner = Kabsch(),
    ):
        self.indices = _checked_indices("indices", indices)
        self.target_indices = None if target_indices is None else _checked_indices("target_indices", target_indices)
        self.aligner = aligner
        if self.target_indices is not None and self.target_indices.shape != self.indices.shape:
            raise ValueError(
                f"Landmarks: {self.indices.shape[0]} indices but {self.target_indices.shape[0]} target_indices; "
                "each landmark needs one partner."
            )

    @property
    def removes_motion(self) -> bool:
        return self.aligner.removes_motion

    def motion(self, points: Float[Array, "n 3"], target: Float[Array, "m 3"]) -> Motion | None:
        partners = self.indices if self.target_indices is None else self.target_indices
        _refuse_outside("points", self.indices, points.shape[0])
        _refuse_outside("target", partners, target.shape[0])
        return self.aligner.motion(points[self.indices], target[partners])


class NoAlignment(Aligner):
    """Leaves the points where they are; costs nothing.

    A loss with it sees rigid motions: on a free shell its value depends on the pose in which the relaxation ends.
    """

    @property
    def removes_motion(self) -> bool:
        return False

    def motion(self, points: Float[Array, "n 3"], target: Float[Array, "m 3"]) -> None:
        return None


def _best_motion(
    name: str, points: Float[Array, "n 3"], target: Float[Array, "m 3"], weights: Array | None, *, scaled: bool
) -> Motion:
    count = points.shape[0]
    if target.shape[0] != count or not count:
        raise ValueError(
            f"{name}: {count} points (shape {points.shape}) against a target of {target.shape[0]} (shape "
            f"{target.shape}); give one target point for each."
        )
    if weights is None:
        share = jnp.full((count, 1), 1 / count, dtype=points.dtype)
    elif weights.shape != (count,):
        raise ValueError(f"{name}: weights of shape {weights.shape} for {count} points; shape ({count},) is needed.")
    else:
        share = (weights / jnp.sum(weights))[:, None]
    origin, onto = jnp.sum(share * points, axis=0), jnp.sum(share * target, axis=0)
    centred = points - origin
    covariance = (share * centred).T @ (target - onto)
    rotation = best_rotation(covariance)
    if not scaled:
        return Motion(rotation, origin, onto)
    spread = jnp.sum(share * centred**2)
    point = spread == 0
    scale = jnp.where(point, 1.0, jnp.sum(rotation * covariance) / jnp.where(point, 1.0, spread))
    return Motion(rotation, origin, onto, scale)


@jax.custom_jvp
def best_rotation(covariance: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    r"""The proper rotation $R$ that maximises $\operatorname{tr}(R^T M)$, with a derivative wherever it is unique.

    With $M = U \Sigma V^T$ it is $U \operatorname{diag}(1, 1, \det UV^T) V^T$. It makes $S = R^T M$ symmetric; so,
    for $dR = R [\omega]_\times$, $(\operatorname{tr}(S) I - S)\,\omega = \operatorname{axial}(R^T dM)$, a matrix
    whose eigenvalues are the sums of two (signed) singular values: it does not mind their being equal.
    """
    u, _, vt = jnp.linalg.svd(covariance)
    handedness = jnp.where(_triple(u) * _triple(vt) < 0, -1.0, 1.0).astype(u.dtype)
    return u.at[:, 2].multiply(handedness) @ vt


@best_rotation.defjvp
def _best_rotation_jvp(primals, tangents):
    (covariance,), (change,) = primals, tangents
    # Calling the wrapped function, not the decomposition, lets higher derivatives come back to this rule.
    rotation = best_rotation(covariance)
    stretch = rotation.T @ covariance
    stiffness = jnp.trace(stretch) * jnp.eye(3, dtype=stretch.dtype) - 0.5 * (stretch + stretch.T)
    turn = rotation.T @ change
    spin = _solve_semidefinite(
        stiffness, jnp.stack([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    )
    zero = jnp.zeros((), spin.dtype)
    cross = jnp.stack([zero, -spin[2], spin[1], spin[2], zero, -spin[0], -spin[1], spin[0], zero]).reshape(3, 3)
    return rotation, rotation @ cross


def _solve_semidefinite(k: Float[Array, "3 3"], a: Float[Array, " 3"]) -> Float[Array, " 3"]:
    r"""Apply the pseudo-inverse of a symmetric positive semidefinite matrix of any rank, as a polynomial in it.

    Each branch interpolates $1/\lambda$ at the eigenvalues that are not zero (by Cayley-Hamilton), through the
    invariants alone, so that it is smooth at equal eigenvalues.
    """
    ka = k @ a
    kka = k @ ka
    c1 = jnp.trace(k)
    c2 = 0.5 * (c1**2 - jnp.sum(k * k))
    c3 = _triple(k)
    negligible = float(jnp.finfo(k.dtype).eps) ** (2 / 3)
    rank_one, rank_two, rank_three = c1 > 0, c2 > negligible * c1**2, c3 > negligible * c1 * c2
    d1, d2, d3 = jnp.where(rank_one, c1, 1.0), jnp.where(rank_two, c2, 1.0), jnp.where(rank_three, c3, 1.0)
    one = jnp.where(rank_one, ka / d1**2, 0.0)
    two = jnp.where(rank_two, ((c1**2 - c2) * ka - c1 * kka) / d2**2, one)
    return jnp.where(rank_two & rank_three, (c2 * a - c1 * ka + kka) / d3, two)


def _triple(m: Float[Array, "3 3"]) -> Scalar:
    return jnp.dot(m[0], jnp.cross(m[1], m[2]))


def checked_weights(name: str, weights: ArrayLike | Sequence) -> Float[Array, " n"]:
    weights = jnp.asarray(weights, dtype=float)
    if weights.ndim != 1:
        raise ValueError(f"{name}: weights has shape {weights.shape}; give one number per point, shape (n,).")
    if not isinstance(weights, Tracer):
        values = np.asarray(weights)
        bad = np.flatnonzero(~(np.isfinite(values) & (values >= 0)))
        if bad.size:
            raise ValueError(f"{name}: weights[{bad[0]}] is {values[bad[0]]}; weights must be finite and not negative.")
        if not values.any():
            raise ValueError(f"{name}: all {values.size} weights are zero; at least one must be positive.")
    return weights


def _checked_indices(name: str, indices: ArrayLike | Sequence) -> Int[Array, " k"]:
    indices = jnp.asarray(indices)
    if indices.ndim != 1 or not jnp.issubdtype(indices.dtype, jnp.integer):
        raise ValueError(
            f"Landmarks: {name} has shape {indices.shape} and type {indices.dtype}; give point numbers, shape (k,)."
        )
    if indices.shape[0] < 3:
        raise ValueError(
            f"Landmarks: {name} has {indices.shape[0]} entries; a rotation is fixed by three points or more."
        )
    return indices


def _refuse_outside(name: str, indices: Int[Array, " k"], count: int) -> None:
    if isinstance(indices, Tracer):
        return
    values = np.asarray(indices)
    outside = values[(values < 0) | (values >= count)]
    if outside.size:
        raise ValueError(
            f"Landmarks: index {outside[0]} lies outside the {name}, which have {count} rows (0 to {count - 1})."
        )
