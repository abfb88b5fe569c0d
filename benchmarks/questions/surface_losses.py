"""Losses between surfaces of different connectivity: value and gradient, with time and memory."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp

import shellkit as sk

from .. import tables
from ..case import Case, Row
from ..measure import profile


_LOSSES = ("PointToSurface", "Chamfer", "Varifold")
_EDGE = 0.0539  # of triangles that the unit sphere takes ten thousand of
_AXES, _TURN = (0.95, 0.95, 1.2), 0.2


def cases(quick: bool) -> list[Case]:
    found = []
    for loss, icp in itertools.product(_LOSSES, (False, True)):
        arguments = {"loss": loss, "icp": icp, "edge": 0.3 if quick else _EDGE, "runs": 3 if quick else 7}
        found.append(Case(f"{loss}{', ICP' if icp else ''}", "questions.surface_losses", arguments, needs_gb=2.0))
    return found


def measure(loss: str, icp: bool, edge: float, runs: int) -> dict:
    """A sphere against an ellipsoid of about as many triangles, which are others."""
    mesh, other = sk.meshes.sphere(edge), sk.meshes.sphere(1.02 * edge)
    cosine, sine = jnp.cos(_TURN), jnp.sin(_TURN)
    turn = jnp.array([[1, 0, 0], [0, cosine, sine], [0, -sine, cosine]])
    target = other.with_vertices((other.vertices * jnp.array(_AXES)) @ turn)
    given = target.vertices if loss == "Chamfer" else target
    aligner = sk.ICP(None if loss == "Chamfer" else target.faces) if icp else sk.NoAlignment()
    wanted = getattr(sk, loss)(given, aligner=aligner)
    start = sk.InverseProblem(mesh, thickness=0.1, energy=sk.StVenantKirchhoff(1.0, 1.0)).unrelaxed()

    def value_and_gradient(vertices: jax.Array):
        here = lambda x: wanted(eqx.tree_at(lambda e: e.vertices, start, x), sk.Passive())
        return jax.value_and_grad(here)(vertices)

    (value, _), record = profile(value_and_gradient, mesh.vertices * 1.01, runs=runs)
    return {"n_faces": [mesh.n_faces, target.n_faces], "value": float(value), "gradient": record}


def page(rows: list[Row]) -> str:
    head = ("loss", "alignment", "faces", "value and gradient", "first run", "memory to run", "compilation")

    def cells(row: Row) -> list[str]:
        record, faces = row["gradient"], "{:,} × {:,}".format(*row["n_faces"])
        return [faces, tables.span(record), *tables.show(record, "first_s", "run_mb", "compile_s")]

    names = lambda row: [row["case"]["loss"], "ICP" if row["case"]["icp"] else "none"]
    return tables.of_rows(head, rows, names, cells)
