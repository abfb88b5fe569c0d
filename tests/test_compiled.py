"""Little is compiled, and nothing twice: programs and lines of them, counted. Times are in the benchmarks."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import optimistix as optx
import pytest

import shellkit as sk
from shellkit._programs.tracing import known, with_parts
from shellkit._relaxation.forward import relax
from shellkit._relaxation.relaxed import Start


_compiled = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, seconds, **_: _compiled.append(event) if event.endswith("backend_compile_duration") else None
)

MESH = sk.meshes.icosphere(subdivisions=1)
ANGLES = jnp.asarray(np.random.default_rng(0).uniform(0, np.pi, MESH.n_faces))
TARGET = jnp.asarray(np.asarray(MESH.vertices) * [0.95, 0.95, 1.2])
WHERE = lambda p: (p.actuation.top.angle, p.actuation.bottom.angle)


def design(**parts):
    layer = lambda: sk.Nematic(angle=ANGLES, stretch=1.1)
    given = {
        "mesh": MESH,
        "thickness": 0.1,
        "actuation": sk.Bilayer(top=layer(), bottom=layer()),
        "energy": sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0),
        "loss": sk.VertexDistance(TARGET, aligner=sk.Kabsch()) + 1e-3 * sk.DirectorSmoothness(),
    }
    return sk.InverseProblem(**(given | parts))


def programs(function):
    """How many programs a call compiles, and what it returns."""
    before = len(_compiled)
    found = jax.block_until_ready(function())
    return len(_compiled) - before, found


def lines(function, *arguments):
    return eqx.filter_jit(function).lower(*arguments).as_text().count("\n")


SCENES = {
    "free": {},
    "clamped": {"mesh": sk.meshes.rectangle(1.0, 1.0, (4, 4)), "supports": sk.Clamped([0, 1, 2, 3, 4])},
    "directors": {"energy": sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0, directors="free")},
    "from young": {"energy": sk.NeoHookean.from_young(1.0, 0.3) + sk.Bending.from_young(1.0, 0.3, form="tan")},
}


@pytest.fixture(scope="module", autouse=True)
def numbers():
    """JAX compiles a program for the first number of a kind that it is handed, whoever does."""
    jnp.asarray(1.1, dtype=float)


@pytest.mark.parametrize("scene", SCENES)
def test_building_a_problem_compiles_nothing(scene):
    parts = dict(SCENES[scene])
    mesh = parts.pop("mesh", MESH)
    zero, target = known(np.zeros(mesh.n_faces)), known(np.asarray(mesh.vertices))

    def build():
        energy = parts.get("energy", sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0))
        loss = sk.VertexDistance(target, aligner=sk.Kabsch())
        sheet = sk.Nematic(angle=zero, stretch=1.1)
        problem = sk.InverseProblem(mesh, 0.1, energy, sheet, loss, supports=parts.get("supports"))
        return problem.mesh.vertices

    assert programs(build)[0] == 0


def test_a_relaxation_is_compiled_once_for_a_kind_of_scene():
    problem = design()
    count, _ = programs(lambda: problem().vertices)
    assert 1 <= count <= 3
    # Other numbers, another loss, an equilibrium to start from: the same program.
    others = known(np.asarray(ANGLES) + 0.1)
    other = eqx.tree_at(lambda p: (p.actuation.top.angle, p.loss), problem, (others, sk.Sphericity()))
    assert programs(lambda: other(problem()).vertices)[0] == 0
    # What a fit compiles besides has no loop over steps in it: the relaxation is not among it.
    fit = lambda p: sk.fit(p, optax.adam(0.1), steps=2, where=WHERE, progress=False)
    first, result = programs(lambda: fit(problem))
    assert first <= 8
    assert programs(lambda: result.problem().vertices)[0] == 0
    assert programs(lambda: fit(result.problem))[0] == 0
    with_target = eqx.tree_at(lambda p: p.loss.terms[0].target, problem, TARGET * 1.01)
    assert programs(lambda: fit(with_target))[0] <= 2


@pytest.mark.parametrize(
    "use",
    [
        lambda p: sk.fit(p, optx.LevenbergMarquardt(1e-6, 1e-9), steps=2, where=WHERE, progress=False).best_loss,
        lambda p: sk.taylor_test(p, where=WHERE).slopes,
        lambda p: sk.identifiability(p, where=WHERE, count=3).singular_values,
        lambda p: sk.distinct_equilibria(p, starts=1).equilibria[0].vertices,
        lambda p: sk.relax(p, path=sk.Ramp(2)).vertices,
        lambda p: sk.follow(p, path=sk.Ramp(2)).vertices,
        lambda p: jax.grad(lambda a: eqx.tree_at(lambda q: q.actuation.top.angle, p, a).evaluate()[0])(ANGLES),
    ],
    ids=["least squares", "taylor", "identifiability", "distinct", "relax", "follow", "grad"],
)
def test_whoever_relaxes_uses_the_same_program(use, monkeypatch):
    import shellkit._relaxation.forward as forward

    traced = []
    minimised = forward.minimised
    # Layers that `at` scales are the same kind of layers, so that paths share the program as well.
    problem = design(thickness=0.09)
    problem()
    # And the whole of the solver, in case that a start or a trial design needs it.
    relax(with_parts(problem, loss=None), Start.of(problem.mesh, problem.assembly, None), False)
    monkeypatch.setattr(forward, "minimised", lambda *parts: traced.append(1) or minimised(*parts))
    jax.block_until_ready(use(problem))
    assert traced == []


def test_the_relaxation_is_a_small_program():
    problem = design(loss=None)
    start = Start.of(problem.mesh, problem.assembly, None)
    assert lines(relax, problem, start, True) <= 5000


def test_each_kernel_stands_once_in_a_relaxation():
    """Arc tangents are taken of hinge angles only: at rest, for a step, for a trial, and at the end."""
    problem = design(loss=None)
    start = Start.of(problem.mesh, problem.assembly, None)
    text = relax.lower(problem, start, True).as_text()
    assert text.count("stablehlo.atan2") + text.count("chlo.atan2") == 4
    assert text.count("stablehlo.while") <= 6
