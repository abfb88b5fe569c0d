"""One step of training, value and gradient of the loss through the relaxation: shellkit against triangulax."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import shellkit as sk

from .. import results, tables
from ..case import Case, Row
from ..measure import profile
from ..problems import design_problem, director_angles, ending
from ..tutorial import gradient_probes, shape_probes


_LIBRARIES = {
    "shellkit": "shellkit",
    "shellkit-threads": "shellkit, `MKL_NUM_THREADS=2`",
    "shellkit-tan": 'shellkit, `form="tan"`',
    "triangulax-published": "triangulax as published",
    "triangulax-cg": "triangulax, CG adjoint",
}


class Scene(NamedTuple):
    """What is designed on a mesh, and what the peer needs for it."""

    name: str  # in the README
    title: str
    loss: str = "ellipsoid"
    stretch: float = 1.1
    max_steps: int = 4000
    dense_gb: float = 1.0  # memory of the adjoint as published
    dense_runs: int = 1


_HEAD_OF_SUZANNE = "Suzanne, 1400 vertices, neo-Hookean, sphericity, λ = 1.5"
_SCENES = {
    "icosphere-1": Scene("ellipsoid, 42 vertices", "42 vertices, ellipsoid, λ = 1.1", dense_runs=9),
    "icosphere-3": Scene("ellipsoid, 642 vertices", "642 vertices, ellipsoid, λ = 1.1", dense_gb=4.0, dense_runs=3),
    "suzanne": Scene("Suzanne, 1400 vertices", _HEAD_OF_SUZANNE, "sphericity", 1.5, 8000, dense_gb=15.0),
    "icosphere-4": Scene("ellipsoid, 2562 vertices", "2562 vertices, ellipsoid, λ = 1.1", dense_gb=48.0),
}
_FIELDS = ("zero", "random")


def cases(quick: bool) -> list[Case]:
    found = []
    for mesh, scene in _SCENES.items():
        if quick and mesh != "icosphere-1":
            continue
        for field in _FIELDS:
            common = {"mesh": mesh, "loss": scene.loss, "stretch": scene.stretch, "field": field}
            ours = common | {"form": "sin", "runs": 9}
            theirs = common | {"max_steps": scene.max_steps}
            dense = theirs | {"adjoint": "dense", "forward": False, "runs": scene.dense_runs}
            cg = theirs | {"adjoint": "cg", "forward": True, "runs": 3}
            label, module = f"{mesh} {field} ", "questions.design_step"
            found.append(Case(label + "shellkit", module, ours))
            found.append(Case(label + "shellkit-threads", module, ours, settings={"MKL_NUM_THREADS": "2"}))
            if scene.loss == "sphericity":
                found.append(Case(label + "shellkit-tan", module, ours | {"form": "tan"}))
            found.append(Case(label + "triangulax-published", "peer", dense, of_peer=True, needs_gb=scene.dense_gb))
            found.append(Case(label + "triangulax-cg", "peer", cg, of_peer=True, needs_gb=2.0))
    return found


def _design_step(problem: sk.InverseProblem):
    def loss(angles):
        value, (_, equilibrium) = eqx.tree_at(director_angles, problem, angles).objective()
        return value, equilibrium

    return jax.value_and_grad(loss, has_aux=True)(director_angles(problem))


def measure(mesh: str, loss: str, stretch: float, field: str, form: str, runs: int) -> dict:
    """The design step on the mesh in a file, and the relaxation alone."""
    problem = design_problem(sk.Mesh.read(mesh), loss, stretch, field, form)
    ((value, equilibrium), gradient), record = profile(_design_step, problem, runs=runs)
    force = jax.grad(problem.total_energy)(equilibrium.vertices)
    record |= ending(equilibrium) | {"force_norm": float(jnp.linalg.norm(force)), "value": float(value)}
    probes = {"shape_probes": shape_probes(equilibrium.vertices), "gradient_probes": gradient_probes(gradient)}
    return record | probes | {"forward": profile(lambda problem: problem().vertices, problem, runs=runs)[1]}


def summary(row: Row, raw: dict[str, Row]) -> Row:
    """The peer's shape and gradient beside shellkit's, where that was measured too."""
    short = results.compact(row)
    ours = raw.get(" ".join([*row["label"].split()[:2], "shellkit"]))
    if "adjoint" in row["case"] and not tables.missing(row) and ours and ours.get("converged"):
        gradient, exact = np.array(row["gradient_probes"]), np.array(ours["gradient_probes"])
        apart = np.subtract(row["shape_probes"], ours["shape_probes"])
        off = float(np.linalg.norm(gradient - exact) / np.linalg.norm(exact))
        short |= results.compact({"shape_error": float(np.max(np.abs(apart))), "gradient_error": off})
    return short


def page(rows: list[Row]) -> str:
    sections = []
    for mesh, scene in _SCENES.items():
        for field in _FIELDS:
            here = {row["label"].split()[2]: row for row in rows if row["label"].split()[:2] == [mesh, field]}
            if here:
                sections.append(f"### {scene.title}, director field {field}\n\n{_table(here)}")
    return "\n\n".join(sections)


_HEAD = ("", "design step", "relaxation alone", "first run", "compilation", "steps", "factorisations")
_HEAD += ("&#124;∇E&#124;", "E − lowest", "memory to run", "to compile", "shape off by", "gradient off by")
_HEAD += ("time, shellkit = 1",)


def _table(here: dict[str, Row]) -> str:
    done = {name: row for name, row in here.items() if not tables.missing(row)}
    lowest = min((row["energy"] for name, row in done.items() if name != "shellkit-tan"), default=0.0)
    ours = done.get("shellkit")

    def cells(row: Row) -> list[str]:
        name = row["label"].split()[2]
        # The peer's relaxation is the same with either adjoint, and was measured once.
        forward = row.get("forward") or done.get("triangulax-cg", {}).get("forward")
        own = row["energy"] if name == "shellkit-tan" else lowest
        times = [tables.span(row), tables.span(forward) if forward else "", *tables.show(row, "first_s", "compile_s")]
        ends = [tables.steps(row), *tables.show(row, "factorisations", "force_norm"), tables.small(row["energy"] - own)]
        others = tables.show(row, "run_mb", "compile_mb", "shape_error", "gradient_error")
        return [*times, *ends, *others, _ratio(row, ours) if row is not ours else ""]

    known = [here[name] for name in _LIBRARIES if name in here]
    return tables.of_rows(_HEAD, known, lambda row: [_LIBRARIES[row["label"].split()[2]]], cells)


def overview(rows: list[Row]) -> str:
    """The table of the README: what a design step costs from random directors, and how exact its relaxation is."""
    known = {row["label"]: row for row in rows if row["case"]["field"] == "random"}
    head = ("scene", "shellkit", "&#124;∇E&#124;", "published", "×", "CG adjoint", "×", "&#124;∇E&#124;")
    lines = []
    for mesh, scene in _SCENES.items():
        names = ("shellkit", "triangulax-published", "triangulax-cg")
        ours, published, cg = [known.get(f"{mesh} random {name}") for name in names]
        if ours or published or cg:
            theirs = [cell for row in (published, cg) for cell in (_time(row), _ratio(row, ours))]
            lines.append([scene.name, _time(ours), _force(ours), *theirs, _force(cg)])
    shown = [row for row in known.values() if not tables.missing(row)]
    loads = [row["load"] for row in shown]
    conditions = (
        f"*{', '.join(dict.fromkeys(row['machine']['cpu'] for row in shown))}, "
        f"{max(row['threads'] for row in shown)} threads; {tables.days(shown)}, {tables.commits(shown)}; "
        f"load of the machine {min(loads)}–{max(loads)}; medians, without compilation. "
        "–: not measured. Too large: needs more memory than there was.*"
    )
    return f"{tables.table(head, lines)}\n\n{conditions}"


def _time(row: Row | None) -> str:
    if row is None:
        return "–"
    if reason := tables.missing(row):
        return "too large" if "GB" in reason else "failed"
    return tables.seconds(row["median_s"]) + ("" if row["converged"] else " (not converged)")


def _ratio(row: Row | None, ours: Row | None) -> str:
    if row is None or ours is None or tables.missing(row) or tables.missing(ours):
        return ""
    return tables.three_digits(row["median_s"] / ours["median_s"])


def _force(row: Row | None) -> str:
    return "" if row is None else tables.show(row, "force_norm")[0]
