"""Sheets that grow or swell, and rest shapes prescribed outright."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from .._citation.papers import EFRATI_2009
from .._mesh.mesh import Mesh
from .._rest import RestShape
from .base import Actuation, SheetActuation, check_per_face
from .frames import stretched_metric


class IsotropicGrowth(SheetActuation):
    """Growth by the same stretch in every direction: metric times stretch squared, curvature form unchanged.

    ??? cite "Source"

        E. Efrati, E. Sharon and R. Kupferman, "Elastic theory of unconstrained non-Euclidean plates", Journal of the
        Mechanics and Physics of Solids 57 (2009), 762.
    """

    papers: ClassVar[tuple[str, ...]] = (EFRATI_2009,)
    stretch: Float[Array, "..."]

    def __init__(self, stretch: float | Array):
        """**Arguments:**

        - `stretch`: of lengths, one number or one per face; swelling and heat expand (> 1), drying shrinks.
        """
        self.stretch = jnp.asarray(stretch, dtype=float)

    def check(self, mesh: Mesh) -> None:
        check_per_face("IsotropicGrowth", "stretch", self.stretch, mesh, scalar=True, positive=True)

    def actuated_metric(self, metric: Float[Array, "F 2 2"]) -> Float[Array, "F 2 2"]:
        return metric * jnp.reshape(self.stretch**2, (-1, 1, 1))

    def at(self, progress: float | Float[Array, ""]) -> "IsotropicGrowth":
        """Slow growth: the stretch goes from 1 to its full value."""
        return eqx.tree_at(lambda sheet: sheet.stretch, self, 1 + progress * (self.stretch - 1))


class OrthotropicGrowth(SheetActuation):
    """Growth by different stretches along a direction in each face and across it, such as of fibres that do not
    swell.

    ??? cite "Source"

        E. Efrati, E. Sharon and R. Kupferman, "Elastic theory of unconstrained non-Euclidean plates", Journal of the
        Mechanics and Physics of Solids 57 (2009), 762.
    """

    papers: ClassVar[tuple[str, ...]] = (EFRATI_2009,)
    angle: Float[Array, " F"]
    along: Float[Array, "..."]
    across: Float[Array, "..."]

    def __init__(self, angle: Float[Array, " F"], along: float | Array, across: float | Array):
        """**Arguments:**

        - `angle`: of the direction in each face, in radians from its first edge; see [`shellkit.director_angles`][].
        - `along`, `across`: stretches of lengths, one number or one per face.
        """
        self.angle = jnp.asarray(angle, dtype=float)
        self.along = jnp.asarray(along, dtype=float)
        self.across = jnp.asarray(across, dtype=float)

    def check(self, mesh: Mesh) -> None:
        check_per_face("OrthotropicGrowth", "angle", self.angle, mesh, scalar=False)
        check_per_face("OrthotropicGrowth", "along", self.along, mesh, scalar=True, positive=True)
        check_per_face("OrthotropicGrowth", "across", self.across, mesh, scalar=True, positive=True)

    def director_fields(self) -> tuple[Float[Array, " F"], ...]:
        return (self.angle,)

    def actuated_metric(self, metric: Float[Array, "F 2 2"]) -> Float[Array, "F 2 2"]:
        return stretched_metric(metric, self.angle, self.along, self.across)

    def at(self, progress: float | Float[Array, ""]) -> "OrthotropicGrowth":
        """Slow growth: both stretches go from 1 to their full values."""
        partial = (1 + progress * (self.along - 1), 1 + progress * (self.across - 1))
        return eqx.tree_at(lambda sheet: (sheet.along, sheet.across), self, partial)


class PrescribedMetric(SheetActuation):
    """The metric of a sheet given outright, in the edge basis of each face: a layer that can grow at will.

    ??? cite "Source"

        E. Efrati, E. Sharon and R. Kupferman, "Elastic theory of unconstrained non-Euclidean plates", Journal of the
        Mechanics and Physics of Solids 57 (2009), 762.
    """

    papers: ClassVar[tuple[str, ...]] = (EFRATI_2009,)
    metric: Float[Array, "F 2 2"]

    def __init__(self, metric: Float[Array, "F 2 2"]):
        """**Arguments:**

        - `metric`: positive definite, one per face; see [`shellkit.first_form`][].
        """
        self.metric = jnp.asarray(metric, dtype=float)

    def check(self, mesh: Mesh) -> None:
        _check_form("PrescribedMetric", "metric", self.metric, mesh)
        _check_positive("PrescribedMetric", self.metric)

    def actuated_metric(self, metric: Float[Array, "F 2 2"]) -> Float[Array, "F 2 2"]:
        return self.metric


class Prescribed(Actuation):
    """Rest forms given outright, in the edge basis of each face; what is `None` stays as the mesh has it.

    ??? cite "Source"

        E. Efrati, E. Sharon and R. Kupferman, "Elastic theory of unconstrained non-Euclidean plates", Journal of the
        Mechanics and Physics of Solids 57 (2009), 762.
    """

    papers: ClassVar[tuple[str, ...]] = (EFRATI_2009,)
    metric: Float[Array, "F 2 2"] | None
    curvature: Float[Array, "F 2 2"] | None

    def __init__(self, metric: Float[Array, "F 2 2"] | None = None, curvature: Float[Array, "F 2 2"] | None = None):
        """**Arguments:**

        - `metric`: positive definite, one per face; see [`shellkit.first_form`][].
        - `curvature`: symmetric, one per face; see [`shellkit.second_form`][].
        """
        self.metric = None if metric is None else jnp.asarray(metric, dtype=float)
        self.curvature = None if curvature is None else jnp.asarray(curvature, dtype=float)

    def check(self, mesh: Mesh) -> None:
        for name, form in (("metric", self.metric), ("curvature", self.curvature)):
            if form is not None:
                _check_form("Prescribed", name, form, mesh)
        if self.metric is not None:
            _check_positive("Prescribed", self.metric)

    def __call__(self, rest: RestShape) -> RestShape:
        metric = rest.metric if self.metric is None else self.metric
        # A scene that measures no curvature has none to prescribe.
        curvature = rest.curvature if self.curvature is None or rest.curvature is None else self.curvature
        return RestShape(metric, curvature, rest.thickness)


def _check_form(owner: str, name: str, form: Array, mesh: Mesh) -> None:
    if form.shape != (mesh.n_faces, 2, 2):
        raise ValueError(f"{owner}: {name} has shape {form.shape}; expected ({mesh.n_faces}, 2, 2), one per face.")
    if isinstance(form, Tracer):
        return
    bad = np.flatnonzero(
        ~np.isfinite(form).all((1, 2)) | (np.abs(form[:, 0, 1] - form[:, 1, 0]) > 1e-12 * np.abs(form).max())
    )
    if len(bad):
        raise ValueError(f"{owner}: the {name} of face {bad[0]} is not finite and symmetric.")


def _check_positive(owner: str, metric: Array) -> None:
    if isinstance(metric, Tracer):
        return
    bad = np.flatnonzero((np.linalg.det(metric) <= 0) | (np.asarray(metric)[:, 0, 0] <= 0))
    if len(bad):
        raise ValueError(f"{owner}: the metric of face {bad[0]} is not positive definite.")
