"""The terms of an energy, sorted by what they are functions of: the only place that tells the kinds apart."""

from typing import NamedTuple

from jaxtyping import Array

from .._geometry.forms import CurvatureForm
from .base import AbstractEnergy, EnergyTerm, FormEnergy
from .constraints import Constraint


class Terms(NamedTuple):
    """The terms of an energy by kind, each with its weight (`None` for one), in the order in which they were added."""

    faces: tuple[tuple[Array | None, FormEnergy], ...]
    """Functions of the fundamental forms of faces."""
    elements: tuple[tuple[Array | None, EnergyTerm], ...]
    """Functions of the positions of a few vertices each."""
    constraints: tuple[tuple[Array | None, Constraint], ...]
    """Constraints of the whole shell that are held."""

    @classmethod
    def of(cls, energy: AbstractEnergy) -> "Terms":
        """Sort the terms of an energy."""
        faces, elements, constraints = [], [], []
        for weight, term in energy.weighted_terms():
            if isinstance(term, FormEnergy):
                faces.append((weight, term))
            elif isinstance(term, Constraint):
                constraints.append((weight, term))
            else:
                elements.append((weight, term))
        return cls(tuple(faces), tuple(elements), tuple(constraints))

    @property
    def bending(self) -> tuple[FormEnergy, ...]:
        """The terms that depend on curvature."""
        return tuple(term for _, term in self.faces if term.form is not None)

    @property
    def form(self) -> CurvatureForm | None:
        """How curvature is measured; `None` where nothing bends."""
        return self.bending[0].form if self.bending else None

    @property
    def bends(self) -> bool:
        """Whether a term depends on curvature."""
        return self.form is not None

    @property
    def has_free_directors(self) -> bool:
        """Whether edges carry directors as unknowns."""
        return any(term.directors == "free" for _, term in self.faces)

    @property
    def measured(self) -> tuple[EnergyTerm, ...]:
        """What is summed over elements of a few vertices: terms, then the quantities that are held."""
        return (*(term for _, term in self.elements), *(constraint.measure() for _, constraint in self.constraints))
