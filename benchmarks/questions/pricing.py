"""Pricing: what each part of a scene costs, from the matrix to the gradient of a loss."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optax

import shellkit as sk
from shellkit._relaxation.augmented_lagrangian import Stationary, padded
from shellkit._solve.linear.bordered import BorderedSolver
from shellkit._solve.null_space import gauged_hessian

from .. import tables
from ..case import Case, Row
from ..measure import profile
from ..problems import bilayer, director_angles, ending, gradient_in, relaxed, to_ellipsoid
from ..tutorial import THICKNESS


# The scenes, and what they are called; each is the second one with something changed.
_SCENES = {
    "stretching": "stretching only",
    "bending": "stretching and bending, free in space",
    "tan": '`form="tan"`',
    "free directors": "free directors",
    "neo-Hookean": "neo-Hookean",
    "bilayer": "two nematic layers in place of growth",
    "pressure": "pressure, which follows",
    "volume": "a held volume",
    "six held": "six coordinates held: no free motions",
    "clamped": "a clamped cap",
    "gravity": "a clamped cap and gravity",
    "contact": "a clamped cap, gravity, a plane to lean on",
    "unaligned": "a loss without alignment",
    "fit": "a step of `fit`, with its history",
}
_SIZES = {"icosphere-1": "42 vertices", "icosphere-3": "642 vertices", "icosphere-4": "2562 vertices"}
_LARGE = ("stretching", "bending", "free directors", "volume", "clamped")
_GROWTH, _UNEVEN = 1.1, 0.05


def cases(quick: bool) -> list[Case]:
    return [
        Case(f"{mesh} {scene}", "questions.pricing", {"mesh": mesh, "scene": scene, "runs": 3 if quick else 9})
        for mesh in (["icosphere-1"] if quick else ["icosphere-3", "icosphere-4"])
        for scene in (_LARGE if mesh == "icosphere-4" else _SCENES)
    ]


def build(name: str, mesh: sk.Mesh) -> sk.InverseProblem:
    """The scene of that name."""
    x, _, z = mesh.vertices.T
    bending = sk.Bending(
        1.0, 1.0, form="tan" if name == "tan" else "sin", directors="free" if name == "free directors" else "average"
    )
    energy = sk.NeoHookean(1.0, 1.0) if name == "neo-Hookean" else sk.StVenantKirchhoff(1.0, 1.0)
    energy = energy if name == "stretching" else energy + bending
    plane = lambda: sk.PlaneContact([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], stiffness=1.0, softness=0.02)
    more = {"pressure": lambda: sk.Pressure(0.01), "volume": lambda: sk.Inflation(1.4)}
    more |= {"gravity": lambda: sk.Gravity(0.001), "contact": lambda: sk.Gravity(0.001) + plane()}
    supports = sk.Clamped(z < -0.7) if name in ("clamped", "gravity", "contact") else None
    if name == "six held":
        # A point, a line through it and a plane: no growth that is even about the axis is hindered.
        top, bottom, side = (int(np.argmax(np.asarray(along))) for along in (z, -z, x))
        supports = sk.Pinned([bottom]) + sk.Sliding([top], along="z") + sk.Sliding([side], normal="y")
    growth = sk.IsotropicGrowth(_GROWTH + _UNEVEN * mesh.vertices[mesh.faces].mean(axis=1)[:, 2])
    angles = jnp.linspace(0.0, np.pi, mesh.n_faces)
    return sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        energy=energy + more[name]() if name in more else energy,
        actuation=bilayer(angles, angles + 0.3, _GROWTH) if name == "bilayer" else growth,
        supports=supports,
        loss=to_ellipsoid(mesh, sk.NoAlignment() if name == "unaligned" else None),
    )


def trained(problem: sk.InverseProblem) -> Any:
    """The arrays in which the loss is differentiated."""
    actuation: Any = problem.actuation
    return director_angles(problem) if isinstance(problem.actuation, sk.Bilayer) else actuation.stretch


def measure(mesh: str, scene: str, runs: int) -> dict:
    """The parts of one scene; of `"fit"` a step of the training of the second one, and no more."""
    if scene == "fit":
        return _fit(build("bending", sk.Mesh.read(mesh)), 4 * runs)
    problem = build(scene, sk.Mesh.read(mesh))
    equilibrium, relaxation = profile(relaxed, problem, runs=runs)
    energy, y, motions, solver = eqx.filter_jit(_at)(problem, equilibrium)
    derivatives = lambda energy, y: energy.derivatives(y)[:3]
    hessian = eqx.filter_jit(lambda energy, y: gauged_hessian(energy.hessian(y), motions, y)[0])(energy, y)
    pattern, still = problem.assembly.pattern, _sparse(energy, equilibrium)
    return ending(equilibrium) | {
        "unknowns": pattern.n,
        "nonzeros": pattern.nnz,
        "derivatives": profile(derivatives, still, y[: pattern.n], runs=runs)[1],
        "factorisation": profile(solver.factorise, hessian, runs=runs)[1],
        "relaxation": relaxation,
        "gradient": profile(gradient_in(trained), problem, runs=runs)[1],
    }


def _at(problem: sk.InverseProblem, equilibrium: sk.Equilibrium):
    """Energy, unknowns, free motions and solver at an equilibrium; with multipliers where it has some."""
    energy, motions, solver = problem.discrete_energy(), problem.rigid_modes(), problem.linear_solver()
    y = problem.assembly.dofs.gather(equilibrium.unknowns)
    multipliers = equilibrium.multipliers
    if multipliers is None:
        return energy, y, motions, solver
    y = jnp.concatenate([y, multipliers])
    return Stationary(energy), y, padded(motions, len(multipliers)), BorderedSolver(solver)


def _sparse(energy, equilibrium: sk.Equilibrium):
    """The energy that a relaxation works on: under the forces that hold its quantities, where it has some."""
    multipliers = equilibrium.multipliers
    return energy if multipliers is None else energy.energy.with_multipliers(multipliers, jnp.ones_like(multipliers))


def _fit(problem: sk.InverseProblem, steps: int) -> dict:
    """The seconds between the rows of a fit that moves by next to nothing."""
    result = sk.fit(problem, optax.sgd(1e-9), steps=steps, where=trained, progress=False)
    seconds = np.diff(result.history["seconds"])
    return {"gradient": {"first_s": float(seconds[0]), "run_s": seconds[1:].tolist()}}


def page(rows: list[Row]) -> str:
    titles = {mesh: f"A sphere of {size}" for mesh, size in _SIZES.items()}
    return tables.sections(titles, rows, "mesh", _table)


_PARTS = ("derivatives", "factorisation", "relaxation", "gradient")


def _table(rows: list[Row]) -> str:
    whole = next((row for row in rows if row["case"]["scene"] == "bending" and not tables.missing(row)), {})

    def names(row: Row) -> list[str]:
        scene = row["case"]["scene"]
        return [("" if scene in ("stretching", "bending", "fit") else "… ") + _SCENES[scene]]

    def cells(row: Row) -> list[str]:
        sizes = [_share(row.get(key), whole.get(key), "{:,}".format) for key in ("unknowns", "nonzeros")]
        median = lambda of, key: of.get(key, {}).get("median_s")
        times = [_share(median(row, key), median(whole, key), tables.seconds) for key in _PARTS]
        return [*sizes, *times, tables.steps(row)]

    return tables.of_rows(("", "unknowns", "non-zeros", *_PARTS[:3], "loss and gradient", "steps"), rows, names, cells)


def _share(value: float | None, whole: float | None, show: Callable[[Any], str]) -> str:
    """A figure, and what it is of that of the whole scene."""
    if value is None:
        return ""
    return show(value) if not whole or value == whole else f"{show(value)} ({value / whole:.2f})"
