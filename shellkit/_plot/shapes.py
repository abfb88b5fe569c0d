"""What there is to draw: each panel of a picture shows one shape, and this is where meshes, equilibria, problems and
fits become shapes."""

import dataclasses
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from .._actuation.director_layers import Directors, director_layers
from .._align.aligners import Aligner, Kabsch, NoAlignment
from .._equilibrium import Equilibrium
from .._fit.history import FitResult
from .._loss import Loss, SumOfLosses, VertexDistance, WeightedLoss
from .._mesh.mesh import Mesh
from .._path.ramp import Path
from .._problem.problem import InverseProblem
from .._problem.states import Equilibria, States


Drawable = Mesh | Equilibrium | Equilibria | InverseProblem | States | FitResult | Path
Target = Mesh | Equilibrium | InverseProblem | ArrayLike | None

_MOST_OF_A_PATH = 4


@dataclass(frozen=True)
class Shape:
    """A mesh with its vertices at `points`, in the place where it is drawn, and the director angles of its layers."""

    mesh: Mesh
    points: np.ndarray
    title: str = ""
    layers: tuple[np.ndarray, ...] = ()
    equilibrium: Equilibrium | None = None
    target: "Shape | None" = None
    problem: InverseProblem | None = None

    def error(self) -> np.ndarray | None:
        """How far each vertex is from its partner in the target, or from a target of another mesh."""
        if self.target is None:
            return None
        if self.target.points.shape == self.points.shape:
            return np.linalg.norm(self.points - self.target.points, axis=1)
        import pyvista as pv

        measured = surface(self).compute_implicit_distance(surface(self.target))
        return np.abs(np.asarray(pv.PolyData(measured)["implicit_distance"]))


def surface(shape: Shape):
    """The shape as pyvista knows it."""
    import pyvista as pv

    return pv.PolyData.from_regular_faces(shape.points, np.asarray(shape.mesh.faces))


def shapes_of(
    thing: Drawable, directors: Directors, target: Target, aligner: Aligner | None, problem: InverseProblem | None
) -> list[Shape]:
    """The shapes that show a thing; more than one for a path and a fit."""
    if isinstance(thing, Mesh):
        shape = Shape(thing, np.asarray(thing.vertices), layers=director_layers("plot", thing, None, directors))
        return [_with_target(shape, _target_of(target, thing), aligner)]
    if isinstance(thing, Equilibrium):
        return [relaxed_shape(thing, problem, directors, target, aligner)]
    if isinstance(thing, InverseProblem):
        shape = _at_rest(thing, directors)
        return [_with_target(shape, _target_of(target, thing.mesh), aligner)]
    if isinstance(thing, Equilibria):
        relaxed = [relaxed_shape(each, problem, directors, target, aligner) for each in thing.values()]
        return [dataclasses.replace(shape, title=name) for name, shape in zip(thing, relaxed, strict=True)]
    if isinstance(thing, States):
        return state_shapes(thing, thing(), directors, target, aligner)
    if isinstance(thing, FitResult):
        return _fit_shapes(thing, directors, target, aligner)
    if isinstance(thing, Path):
        shapes = path_shapes(thing, directors, target, aligner, problem)
        chosen = np.linspace(0, len(shapes) - 1, min(len(shapes), _MOST_OF_A_PATH)).round().astype(int)
        return [shapes[k] for k in chosen]
    raise ValueError(
        f"plot: cannot draw a {type(thing).__name__}; give a Mesh, an Equilibrium, an InverseProblem, States, a "
        "FitResult, a Path, or a list of them."
    )


def relaxed_shape(
    equilibrium: Equilibrium,
    problem: InverseProblem | None,
    directors: Directors,
    target: Target,
    aligner: Aligner | None,
) -> Shape:
    """An equilibrium where it is drawn, with its directors if the problem or the caller tells them."""
    mesh = equilibrium.mesh
    actuation = None if problem is None else problem.actuation
    layers, goal = director_layers("plot", mesh, actuation, directors), _target_of(target, mesh)
    shape = Shape(mesh, np.asarray(equilibrium.vertices), "", layers, equilibrium, None, problem)
    same = goal is not None and goal.points.shape == shape.points.shape
    # A relaxed shell may lie anywhere in space.
    return _with_target(shape, goal, Kabsch() if aligner is None and same else aligner)


def path_shapes(
    path: Path, directors: Directors, target: Target, aligner: Aligner | None, problem: InverseProblem | None
) -> list[Shape]:
    """Every equilibrium of a path."""
    titles = [f"{progress:.0%}" for progress in np.asarray(path.progress).tolist()]
    # Fields of the material, too, belong to the moment.
    problems = [None if problem is None else problem.at(progress) for progress in path.progress]
    return [
        dataclasses.replace(relaxed_shape(each, partial, directors, target, aligner), title=title)
        for each, partial, title in zip(path.equilibria, problems, titles, strict=True)
    ]


def fit_shapes(
    problem: InverseProblem,
    equilibrium: Equilibrium,
    directors: Directors,
    target: Target,
    aligner: Aligner | None,
) -> list[Shape]:
    """A design at rest and relaxed, beside the target of its loss."""
    wanted = None if problem.loss is None else _wanted(problem.loss)
    if wanted is not None:
        target = wanted.target if target is None else target
        aligner = wanted.aligner if aligner is None else aligner
    return [_at_rest(problem, directors), relaxed_shape(equilibrium, problem, directors, target, aligner)]


def state_shapes(
    states: States, equilibria: Equilibria, directors: Directors, target: Target, aligner: Aligner | None
) -> list[Shape]:
    """Each state relaxed, with the target of its loss, in the order of the states."""
    shapes = []
    for name in states.names:
        _, relaxed = fit_shapes(states[name], equilibria[name], directors, target, aligner)
        shapes.append(dataclasses.replace(relaxed, title=name))
    return shapes


def _fit_shapes(result: FitResult, directors: Directors, target: Target, aligner: Aligner | None) -> list[Shape]:
    problem = result.problem
    if not isinstance(problem, InverseProblem | States):
        raise ValueError(
            f"plot: the fit trained a {type(problem).__name__}, which is no InverseProblem; plot its parts one by one."
        )
    equilibrium: Any = problem() if result.equilibrium is None else result.equilibrium
    if isinstance(problem, States):
        return state_shapes(problem, equilibrium, directors, target, aligner)
    start, best = fit_shapes(problem, equilibrium, directors, target, aligner)
    shapes = [dataclasses.replace(start, title="at rest"), dataclasses.replace(best, title="relaxed")]
    return shapes if best.target is None else [*shapes, dataclasses.replace(best.target, title="target")]


def _at_rest(problem: InverseProblem, directors: Directors) -> Shape:
    mesh = problem.mesh
    layers = director_layers("plot", mesh, problem.actuation, directors)
    return Shape(mesh, np.asarray(mesh.vertices), layers=layers, problem=problem)


def _with_target(shape: Shape, goal: Shape | None, aligner: Aligner | None) -> Shape:
    if goal is None:
        return shape
    aligner = NoAlignment() if aligner is None else aligner
    points = np.asarray(aligner(jnp.asarray(shape.points), jnp.asarray(goal.points)))
    return dataclasses.replace(shape, points=points, target=goal)


def _target_of(target: Target, mesh: Mesh) -> Shape | None:
    if target is None:
        return None
    if isinstance(target, Mesh):
        return Shape(target, np.asarray(target.vertices))
    if isinstance(target, Equilibrium):
        return Shape(target.mesh, np.asarray(target.vertices), equilibrium=target)
    if isinstance(target, InverseProblem):
        return relaxed_shape(target(), target, True, None, None)
    points = np.asarray(target, dtype=float)
    if points.shape != mesh.vertices.shape:
        raise ValueError(
            f"plot: target has shape {points.shape}, but the mesh has {mesh.n_vertices} vertices: give positions of "
            f"shape {mesh.vertices.shape}, or a Mesh of its own."
        )
    return Shape(mesh, points)


def _wanted(loss: Loss) -> VertexDistance | None:
    """The first term of a loss that names a shape to become."""
    if isinstance(loss, VertexDistance):
        return loss
    if isinstance(loss, WeightedLoss):
        return _wanted(loss.term)
    terms = loss.terms if isinstance(loss, SumOfLosses) else ()
    return next((found for found in map(_wanted, terms) if found is not None), None)
