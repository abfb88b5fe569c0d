"""What a scene does not need costs it nothing: non-zeros, unknowns, leaves, and operations of traced programs, counted.

That symbolic analysis is done once per pattern is counted in tests/solve, what is imported in tests/test_package.py.
"""

from collections import Counter

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk
from shellkit._energy import Assembly
from shellkit._relaxation.minimise import objective_of
from shellkit._solve.linear import superlu
from shellkit._solve.matrices.pattern import SymmetricPattern
from shellkit._solve.newton.objective import NewtonObjective


BALL = sk.meshes.icosphere(subdivisions=1)
SHEET = sk.meshes.rectangle(length=1.0, width=1.0, cells=(3, 3))
STRETCHING, BENDING = sk.StVenantKirchhoff(1.0, 1.0), sk.Bending(1.0, 1.0)
SOLVER = sk.SparseNewton(linear_solver=superlu.SuperLU())
LEFT = lambda x: x[:, 0] < 0.1
LAYERS = sk.Bilayer(sk.Nematic(jnp.zeros(BALL.n_faces), 1.1), sk.Nematic(jnp.ones(BALL.n_faces), 1.1))


def scene(mesh=BALL, energy=STRETCHING + BENDING, **parts):
    return sk.InverseProblem(mesh, 0.1, energy, solver=SOLVER, **parts)


def operations(function, *arguments) -> Counter:
    """How often each primitive stands in the program of a function, those of loops and branches included."""
    counts = Counter()

    def visit(jaxpr):
        for equation in jaxpr.eqns:
            counts[equation.primitive.name] += 1
            inner = jax.tree.leaves(list(equation.params.values()), is_leaf=lambda x: hasattr(x, "eqns"))
            for part in inner:
                if hasattr(part, "eqns"):
                    visit(part)

    visit(eqx.filter_make_jaxpr(function)(*arguments)[0])
    return counts


def nonzeros(energy, mesh=BALL):
    return Assembly.of(energy.on(mesh), mesh).pattern.nnz


def relaxation(problem):
    return operations(lambda p: p(), problem)


@pytest.fixture(scope="module")
def free():
    """The program of a relaxation with everything that a free shell needs."""
    return relaxation(scene())


def test_without_bending_faces_couple_their_corners_only():
    """Six entries a vertex and nine an edge, of the upper half; with bending those of a hinge come in."""
    ball = sk.meshes.icosphere(subdivisions=3)
    membrane = nonzeros(STRETCHING, ball)
    assert membrane == 6 * ball.n_vertices + 9 * ball.n_edges
    assert membrane <= 0.4 * nonzeros(STRETCHING + BENDING, ball)


def test_without_bending_the_derivatives_take_a_fraction_of_the_operations():
    count = lambda problem: operations(
        lambda p: p.discrete_energy().derivatives(p.mesh.vertices.reshape(-1))[:3], problem
    ).total()
    membrane = scene(energy=STRETCHING)
    assert count(membrane) < 0.4 * count(scene())
    assert eqx.filter_eval_shape(lambda p: p.rest_shape(), membrane).curvature is None


def test_without_bending_no_strain_is_an_unknown_of_its_own():
    stretching, bending = (
        objective_of(scene(energy=e).discrete_energy(), None, jnp.ones(())) for e in (STRETCHING, BENDING)
    )
    assert stretching.mixed is None and bending.mixed is not None


def test_parts_of_the_solver_that_are_left_out_are_not_traced():
    pattern = SymmetricPattern.of(np.arange(2), np.arange(2), 2)[0]
    hessian = lambda y: sk.SparseSymmetric(pattern, jnp.cosh(y))

    def count(**parts):
        newton = sk.SparseNewton(linear_solver=superlu.SuperLU(), **parts).core
        objective = NewtonObjective.from_options(lambda y, _: (jnp.sum(jnp.cosh(y)), None), None, {"hessian": hessian})
        return operations(lambda y: newton.minimise(objective, y, 9)[0].point.y, jnp.ones(2))

    whole = count()
    # Small eigenproblems in a loop find the way off a saddle; corrections have two loops, and a shift has one.
    assert whole["eigh"] == 2 and count(saddle_escape=None)["eigh"] == 0
    loops = lambda **parts: count(**parts)["while"] + count(**parts)["scan"]
    every = whole["while"] + whole["scan"]
    assert loops(corrections=None) == every - 2
    # Without a shift no saddle is seen.
    assert loops(saddle_escape=None) == every - 1
    assert loops(shift=None) == every - 2
    assert count(line_search=None).total() < whole.total()


def test_without_free_directors_edges_have_no_unknowns():
    average, free = scene(), scene(energy=STRETCHING + sk.Bending(1.0, 1.0, directors="free"))
    assert average.assembly.pattern.n == 3 * BALL.n_vertices
    assert free.assembly.pattern.n == 3 * BALL.n_vertices + BALL.n_edges
    assert average.assembly.dofs.director_length is None and average.assembly.dofs.n_directors == 0


def test_passive_shells_keep_their_rest_shape():
    at_rest = operations(lambda mesh: sk.RestShape.of(mesh, jnp.asarray(0.1), "sin"), BALL)
    passive, actuated = (
        operations(lambda p: p.rest_shape(), scene(actuation=actuation)) for actuation in (sk.Passive(), LAYERS)
    )
    assert passive == at_rest and actuated.total() > at_rest.total()


def test_what_is_held_is_not_in_the_matrix():
    """Of 16 vertices four, and the three edges between these."""
    shell = STRETCHING + sk.Bending(1.0, 1.0, directors="free")
    of = lambda supports: Assembly.of(shell, SHEET, supports and supports.on(SHEET))
    free, held, sliding = map(of, (None, sk.Clamped(LEFT), sk.Sliding(LEFT, normal="x")))
    assert free.dofs.free is None and free.pattern.n - held.pattern.n == 3 * 4 + 3
    assert held.pattern.nnz < free.pattern.nnz
    assert free.pattern.n - sliding.pattern.n == 4


@pytest.mark.parametrize(
    "part",
    [
        sk.Gravity(1.0),
        sk.Pressure(0.1),
        sk.PointLoad([3], [0.0, 0.0, 1.0]),
        sk.Foundation(1.0),
        sk.PlaneContact([0.0, 0.0, -1.0], [0.0, 0.0, 1.0], stiffness=1.0, softness=0.1),
        sk.VolumeConstraint(),
        sk.AreaConstraint(),
    ],
    ids=lambda part: type(part).__name__,
)
def test_loads_contact_and_constraints_add_no_nonzeros(part):
    assert nonzeros(STRETCHING + part) == nonzeros(STRETCHING)


def test_a_load_alone_has_no_matrix():
    loads = Assembly.of(sk.Gravity(1.0) + sk.PointLoad([3], [0.0, 0.0, 1.0]), SHEET)
    assert loads.pattern.nnz == loads.pattern.n == 48  # the diagonal, which every matrix has
    assert loads.element_entries == (None, None)


def test_only_free_shells_look_for_rigid_motions(free):
    problem = scene(SHEET, supports=sk.Clamped(LEFT))
    assert problem.rigid_modes() is None
    clamped = relaxation(problem)
    # Neither a gauge, six coordinates that move most, nor a pose that would have to be brought back.
    assert free["argmax"] > clamped["argmax"]
    assert free["svd"] > 0 and clamped["svd"] == 0


def test_a_relaxation_wakes_no_threads_of_lapack(free):
    """They spin for 20 ms after a call, on the cores that assembly needs. The decompositions of three by three numbers
    that are left, of the pose and at a saddle, are done by one."""
    assert free["qr"] + free["geqrf"] + free["householder_product"] + free["cholesky"] == 0


def test_an_equilibrium_has_no_part_that_the_scene_has_not():
    report = lambda problem: eqx.filter_eval_shape(lambda p: p(), problem)
    membrane = report(scene(energy=STRETCHING))
    for absent in ("directors", "reactions", "moments", "multipliers", "worst_hinge"):
        assert getattr(membrane, absent) is None, absent
    everything = STRETCHING + sk.Bending(1.0, 1.0, directors="free") + sk.AreaConstraint()
    full = report(scene(SHEET, everything, supports=sk.Clamped(LEFT)))
    for present in ("directors", "reactions", "moments", "multipliers", "worst_hinge"):
        assert getattr(full, present) is not None, present


def test_a_loss_that_does_not_see_the_shape_needs_no_relaxation():
    blind = scene(actuation=LAYERS, loss=sk.DirectorSmoothness())
    program = operations(eqx.filter_value_and_grad(lambda p: p.evaluate()[0]), blind)
    assert program["while"] == program["pure_callback"] == 0


def test_without_an_aligner_nothing_is_decomposed():
    sheet = scene(SHEET, supports=sk.Clamped(LEFT))
    at_rest = sheet.unrelaxed()
    counts = [
        operations(sk.VertexDistance(SHEET.vertices, aligner=aligner), at_rest, sheet.actuation)["svd"]
        for aligner in (sk.NoAlignment(), sk.Kabsch())
    ]
    assert counts == [0, 1]


@pytest.fixture(scope="module")
def gradient():
    """What the gradient of a loss in the angles of the upper layer factorises, solves and operates on."""
    problem = scene(actuation=LAYERS, loss=sk.VertexDistance(BALL.vertices, aligner=sk.NoAlignment()))

    def of(where):
        chosen = where(problem)
        loss = lambda arrays: eqx.tree_at(where, problem, arrays).evaluate()[0]
        return loss, chosen

    return of


def test_frozen_arrays_have_no_derivative(gradient):
    top, both = lambda p: p.actuation.top.angle, lambda p: (p.actuation.top.angle, p.actuation.bottom.angle)
    one, two = (operations(jax.value_and_grad(loss), chosen) for loss, chosen in map(gradient, (top, both)))
    assert two.total() > one.total()
    assert two["cos"] > one["cos"]  # the derivative of the angle that is frozen


def test_a_gradient_adds_one_factorisation_to_a_relaxation(gradient, monkeypatch):
    """That of the Hessian at the equilibrium itself; with Newton's last one, of the point before, a small system would
    need more sweeps than it spares."""
    loss, chosen = gradient(lambda p: p.actuation.top.angle)
    decompose, made = superlu._decompose, []
    monkeypatch.setattr(superlu, "_decompose", lambda *matrix: made.append(1) or decompose(*matrix))

    def factorised(function):
        made.clear()
        jax.block_until_ready(function(chosen))
        return len(made)

    assert factorised(jax.value_and_grad(loss)) - factorised(loss) == 1
