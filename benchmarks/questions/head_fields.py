"""Many director fields on one head: whether each relaxation from rest reaches full tolerance, and in how many steps."""

import itertools
import statistics
from collections import Counter
from collections.abc import Iterator

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optax

import shellkit as sk

from .. import results, tables
from ..case import Case, Row
from ..measure import timed
from ..problems import bilayer, design_problem, director_angles, ending


_KINDS = {
    "random": "random, one angle per face and layer",
    "training": "met along a training run from all angles at zero",
    "orthogonal": "along z on top, across it below",
}
_STRETCH = 1.5


def cases(quick: bool) -> list[Case]:
    found = []
    for kind, form in itertools.product(_KINDS, ("tan", "sin")):
        count = 1 if kind == "orthogonal" else 3 if quick else 50
        arguments = {"mesh": "suzanne", "kind": kind, "form": form, "count": count}
        found.append(Case(f"{kind} {form}", "questions.head_fields", arguments, limit_s=1800.0))
    return found


def measure(mesh: str, kind: str, form: str, count: int) -> dict:
    """How each relaxation ends, at `count` fields of a kind."""
    problem = design_problem(sk.Mesh.read(mesh), "sphericity", _STRETCH, "zero", form)
    timed(problem, runs=1)  # compiled
    fields = []
    for field in _FIELDS[kind](problem, count):
        found, record = timed(field, runs=1)
        ended = {"stable": bool(found.stable), "result": sk.RESULTS[found.result]}
        fields.append({"seconds": record["run_s"][0]} | ending(found) | ended)
    return {"fields": fields}


def _random(problem: sk.InverseProblem, count: int) -> Iterator[sk.InverseProblem]:
    generator = np.random.default_rng(0)
    for _ in range(count):
        angles = tuple(map(jnp.asarray, generator.uniform(0, np.pi, (2, problem.mesh.n_faces))))
        yield eqx.tree_at(director_angles, problem, angles)


def _along_training(problem: sk.InverseProblem, count: int) -> list[sk.InverseProblem]:
    """Those of every second step of a training run from all angles at zero."""
    met, steps = [], 2 * count
    keep = lambda step: met.append(step.problem) if step.step % 2 == 0 else None
    rate = optax.cosine_decay_schedule(0.15, steps, alpha=0.02)
    optimiser = optax.chain(optax.clip_by_global_norm(0.004), optax.adam(rate, b2=0.99))
    options = {"progress": False, "warm_start": sk.WarmStart(), "refuse": sk.Refuse(rise=0.1)}
    sk.fit(problem, optimiser, steps=steps, where=director_angles, callbacks=[keep], **options)
    return met


def _orthogonal(problem: sk.InverseProblem, count: int) -> list[sk.InverseProblem]:
    along = sk.director_angles(problem.mesh, jnp.array([0.0, 0.0, 1.0]))
    crossed = bilayer(along, along + jnp.pi / 2, _STRETCH)
    return [eqx.tree_at(lambda p: p.actuation, problem, crossed)] * count


_FIELDS = {"random": _random, "training": _along_training, "orthogonal": _orthogonal}


def summary(row: Row, raw: dict[str, Row]) -> Row:
    """What came of all fields of a kind."""
    if tables.missing(row):
        return row
    found = row["fields"]
    done = [field for field in found if field["converged"]]
    # The first sentence of a result says what happened, the others what to do.
    others = Counter(field["result"].split(":")[0] for field in found if not field["converged"])
    short = {
        "tried": len(found),
        "converged": len(done),
        "stable": sum(field["stable"] for field in done),
        "others": dict(sorted(others.items())),
        "median_s": statistics.median(field["seconds"] for field in found),
        "span_s": [pick(field["seconds"] for field in found) for pick in (min, max)],
    }
    for name in ("steps", "factorisations") if done else ():
        counts = [field[name] for field in done]
        short[name] = {"median": statistics.median(counts), "most": max(counts)}
    if done:
        short["force_norm"] = max(field["force_norm"] for field in done)
    return results.compact({key: value for key, value in row.items() if key != "fields"} | short)


def page(rows: list[Row]) -> str:
    head = ("directors", "form", "fields", "converged", "of these stable", "others", "steps", "factorisations")
    head += ("largest &#124;∇E&#124;", "a relaxation")

    def cells(row: Row) -> list[str]:
        counts = [row.get(name) for name in ("steps", "factorisations")]
        shown = [f"{count['median']:g}, at most {count['most']}" if count else "" for count in counts]
        ended = [*tables.show(row, "tried", "converged", "stable"), "; ".join(row["others"]) or "–"]
        return [*ended, *shown, *tables.show(row, "force_norm", "median_s")]

    names = lambda row: [_KINDS[row["case"]["kind"]], f"`{row['case']['form']}`"]
    return tables.of_rows(head, rows, names, cells)
