"""What an actuation is: a map from the rest shape of a sheet to the one that it would like to have."""

import abc
from typing import ClassVar

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from .._mesh.mesh import Mesh
from .._rest import RestShape


class Actuation(eqx.Module):
    """Turns the rest shape of a mesh into the rest shape under actuation. Subclass it to write one of your own.

    Any array of an actuation can be trained. Nothing is assumed of how it is made, except that it maps a
    [`shellkit.RestShape`][] to another with the same faces.
    """

    papers: ClassVar[tuple[str, ...]] = ()
    """What to cite for it, as BibTeX; see [`shellkit.InverseProblem.citation`][]."""

    @abc.abstractmethod
    def __call__(self, rest: RestShape) -> RestShape:
        """The rest shape under actuation."""

    def director_fields(self) -> tuple[Float[Array, " F"], ...]:
        """The fields of director angles in this actuation, one per layer; none by default."""
        return ()

    def at(self, progress: float | Float[Array, ""]) -> "Actuation":
        """This actuation, gone through by a fraction `progress` between 0 (none) and 1 (all of it).

        By default the two forms are interpolated; a nematic sheet is heated slowly instead.
        """
        return PartialActuation(self, progress)

    def on(self, mesh: Mesh) -> "Actuation":
        """This actuation as fields on the faces of a mesh: itself, unless it is a function of where they are."""
        return self

    def check(self, mesh: Mesh) -> None:
        """Raise a `ValueError` if this actuation does not fit the mesh; called when a problem is built."""


class PartialActuation(Actuation):
    """An actuation of which a fraction has happened: forms interpolated between the rest shape and the actuated one."""

    whole: Actuation
    progress: float | Float[Array, ""]

    def __call__(self, rest: RestShape) -> RestShape:
        actuated = self.whole(rest)
        # Layers are as stiff before they are actuated as after.
        factors = lambda shape: (shape.stretching, shape.bending)
        rest = eqx.tree_at(factors, rest, factors(actuated), is_leaf=lambda leaf: leaf is None)
        return jax.tree.map(lambda start, end: start + self.progress * (end - start), rest, actuated)

    def director_fields(self) -> tuple[Float[Array, " F"], ...]:
        return self.whole.director_fields()

    def on(self, mesh: Mesh) -> "PartialActuation":
        return PartialActuation(self.whole.on(mesh), self.progress)

    def check(self, mesh: Mesh) -> None:
        self.whole.check(mesh)


class SheetActuation(Actuation):
    """An actuation that changes the metric of a sheet and leaves its curvature form and thickness alone."""

    @abc.abstractmethod
    def actuated_metric(self, metric: Float[Array, "F 2 2"]) -> Float[Array, "F 2 2"]:
        """The metric under actuation."""

    def __call__(self, rest: RestShape) -> RestShape:
        return RestShape(self.actuated_metric(rest.metric), rest.curvature, rest.thickness)

    def at(self, progress: float | Float[Array, ""]) -> "SheetActuation":
        """This sheet, gone through by a fraction `progress`: by default its metric is interpolated."""
        return PartialSheet(self, progress)

    def on(self, mesh: Mesh) -> "SheetActuation":
        """This sheet as fields on the faces of a mesh: itself, unless it is a function of where they are."""
        return self


class PartialSheet(SheetActuation):
    """A sheet of whose actuation a fraction has happened: metric interpolated between rest and actuated."""

    whole: SheetActuation
    progress: float | Float[Array, ""]

    def actuated_metric(self, metric: Float[Array, "F 2 2"]) -> Float[Array, "F 2 2"]:
        return metric + self.progress * (self.whole.actuated_metric(metric) - metric)

    def director_fields(self) -> tuple[Float[Array, " F"], ...]:
        return self.whole.director_fields()

    def on(self, mesh: Mesh) -> "PartialSheet":
        return PartialSheet(self.whole.on(mesh), self.progress)

    def check(self, mesh: Mesh) -> None:
        self.whole.check(mesh)


class Passive(SheetActuation):
    """No actuation: the rest shape stays what it is."""

    def actuated_metric(self, metric: Float[Array, "F 2 2"]) -> Float[Array, "F 2 2"]:
        return metric

    def at(self, progress: float | Float[Array, ""]) -> "Passive":
        return self


def check_per_face(owner: str, name: str, value: Array, mesh: Mesh, *, scalar: bool, positive: bool = False) -> None:
    """Refuse a field that does not fit the faces, is not finite, or is not positive where it must be."""
    expected = f"one per face, shape ({mesh.n_faces},)"
    if value.shape != (mesh.n_faces,) and not (scalar and value.shape == ()):
        raise ValueError(
            f"{owner}: {name} has shape {value.shape}, but the mesh has {mesh.n_faces} faces and "
            f"{mesh.n_vertices} vertices; "
            f"give {'one number or ' if scalar else ''}{expected}."
        )
    if isinstance(value, Tracer):
        return
    numbers = np.atleast_1d(np.asarray(value))
    bad = np.flatnonzero(~np.isfinite(numbers) | (positive & ~(numbers > 0)))
    if len(bad):
        where = f" of face {bad[0]}" if numbers.size > 1 else ""
        kind = "finite and positive" if positive else "finite"
        raise ValueError(f"{owner}: the {name}{where} is {numbers[bad[0]]}; it must be {kind}.")
