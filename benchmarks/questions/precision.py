"""What single precision would cost: errors of energies, forces and Newton steps in it, over the thickness."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import shellkit as sk

from .. import tables
from ..case import Case, Row
from ..problems import rolling
from ..tutorial import roll_curvature


_THICKNESSES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)


def cases(quick: bool) -> list[Case]:
    return [Case("rolled square", "questions.precision")]


def measure() -> dict:
    """For each thickness: relative errors of the energy, of the forces and of a Newton step, and the condition number.

    The rolled square is relaxed in double precision, a thin one from a thicker one. Then the curvature that it would
    like to have is changed by a tenth, and all is evaluated in single precision and in double.
    """
    mesh = sk.meshes.rectangle(1.0, 1.0, cells=(8, 8))
    curvature = roll_curvature(mesh.vertices, mesh.faces)
    equilibrium = None

    @eqx.filter_jit
    def derivatives(problem, vertices):
        energy = problem.discrete_energy()
        y = vertices.reshape(-1)
        return energy(y), energy.gradient(y), energy.hessian(y).as_matrix()

    rows = []
    for thickness in _THICKNESSES:
        problem = rolling(mesh, thickness)
        equilibrium = problem(equilibrium)
        if not equilibrium.converged:
            raise RuntimeError(f"h = {thickness}: {sk.RESULTS[equilibrium.result]}")
        # Coordinates that single precision holds exactly: what is compared is the arithmetic.
        shape = equilibrium.vertices.astype(jnp.float32).astype(float)
        problem = eqx.tree_at(lambda p: p.actuation, problem, sk.Prescribed(curvature=0.9 * curvature))
        single = jax.tree.map(lambda x: x.astype(jnp.float32) if eqx.is_inexact_array(x) else x, problem)
        exact = [np.asarray(part, float) for part in derivatives(problem, shape)]
        found = [np.asarray(part, float) for part in derivatives(single, shape.astype(jnp.float32))]
        values = np.linalg.eigvalsh(exact[2])
        steps = [_step(gradient, hessian) for _, gradient, hessian in (exact, found)]
        off = lambda a, b: float(np.linalg.norm(np.asarray(a) - b) / np.linalg.norm(b))
        errors = {"energy": off(found[0], exact[0]), "force": off(found[1], exact[1]), "step": off(steps[1], steps[0])}
        condition = float(np.abs(values).max() / np.sort(np.abs(values))[6])
        rows.append({"thickness": thickness, **errors, "condition": condition})
    return {"thicknesses": rows}


def _step(gradient: np.ndarray, hessian: np.ndarray) -> np.ndarray:
    """Newton's step, off the six rigid motions."""
    values, vectors = np.linalg.eigh(hessian)
    stiff = np.argsort(np.abs(values))[6:]
    return -vectors[:, stiff] @ ((vectors[:, stiff].T @ gradient) / values[stiff])


def page(rows: list[Row]) -> str:
    head = ("h", "energy off by", "forces off by", "Newton's step off by", "condition number of the Hessian")
    columns = next((row["thicknesses"] for row in rows if not tables.missing(row)), {})
    thickness, *others = (columns.get(key, []) for key in ("thickness", "energy", "force", "step", "condition"))
    lines = [[f"{h:g}", *map(tables.small, errors)] for h, *errors in zip(thickness, *others, strict=True)]
    return tables.table(head, lines)
