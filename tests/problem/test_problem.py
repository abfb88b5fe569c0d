"""The whole problem: exact relaxations, diagnostics, sensitivities, minimisers, refusals, and what is skipped."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

import shellkit as sk


MESH = sk.meshes.icosphere(subdivisions=1)
ENERGY = sk.StVenantKirchhoff(alpha=1.0, beta=1.0) + sk.Bending(alpha=1.0, beta=1.0)


def bilayer(top, bottom, stretch=1.1):
    return sk.Bilayer(sk.Nematic(top, stretch), sk.Nematic(bottom, stretch))


def random_problem(seed=0, **changes):
    rng = np.random.default_rng(seed)
    angles = jnp.asarray(rng.uniform(0, np.pi, (2, MESH.n_faces)))
    parts = dict(
        mesh=MESH,
        thickness=0.1,
        actuation=bilayer(*angles),
        energy=ENERGY,
        loss=sk.VertexDistance(MESH.vertices * jnp.array([0.95, 0.95, 1.2]), aligner=sk.Kabsch()),
    )
    return sk.InverseProblem(**{**parts, **changes})


def swollen(stretch, mesh=MESH):
    return sk.InverseProblem(
        mesh=mesh, thickness=0.2, energy=ENERGY, actuation=sk.IsotropicGrowth(jnp.asarray(stretch))
    )


def test_passive_shell_stays():
    equilibrium = sk.InverseProblem(mesh=MESH, thickness=0.1, energy=ENERGY)()
    assert bool(equilibrium.converged) and bool(equilibrium.stable)
    assert jnp.allclose(equilibrium.vertices, MESH.vertices, atol=1e-12)


def test_swollen_sphere():
    """rho³ + (eta - lambda²) rho - eta = 0 with eta = h²/6, and its slope in lambda, both up to the mesh."""
    mesh = sk.meshes.icosphere(subdivisions=2)
    radius = lambda p: jnp.linalg.norm(p().vertices, axis=1).mean()
    value, slope = eqx.filter_value_and_grad(radius)(swollen(1.1, mesh))
    eta = 0.2**2 / 6
    rho = max(np.roots([1, 0, eta - 1.1**2, -eta]).real)
    assert np.isclose(float(value), rho, rtol=0, atol=5e-5)
    assert np.isclose(float(slope.actuation.stretch), 2 * 1.1 * rho / (3 * rho**2 + eta - 1.1**2), rtol=2e-3)


def test_growth_of_both_forms_is_exact_on_any_mesh():
    """Metric times lambda² and curvature times lambda: the scaled surface has no energy at all."""
    rest = sk.RestShape.of(MESH, jnp.asarray(0.1), "sin")
    grown = sk.Prescribed(metric=1.1**2 * rest.metric, curvature=1.1 * rest.curvature)
    equilibrium = sk.InverseProblem(mesh=MESH, thickness=0.1, energy=ENERGY, actuation=grown)()
    assert float(equilibrium.energy) < 1e-20
    assert jnp.allclose(equilibrium.vertices, 1.1 * MESH.vertices, atol=1e-10)


def test_full_tolerance_in_few_steps():
    for seed in range(3):
        equilibrium = random_problem(seed)()
        assert bool(equilibrium.converged) and bool(equilibrium.stable)
        assert float(equilibrium.gradient_norm) < 1e-12
        assert int(equilibrium.steps) <= 15


@pytest.mark.slow
def test_other_minimisers_reach_the_same_state():
    newton = random_problem()
    reference = newton().vertices
    for solver in (optx.NonlinearCG(rtol=1e-9, atol=1e-9), optx.BFGS(rtol=1e-9, atol=1e-9)):
        problem = random_problem(solver=solver)
        equilibrium = problem()
        assert jnp.allclose(equilibrium.vertices, reference, atol=1e-6)
        assert bool(equilibrium.stable)


@pytest.mark.parametrize(
    "where",
    [
        lambda p: p.actuation.top.angle,
        lambda p: p.actuation.bottom.stretch,
        lambda p: p.thickness,
        lambda p: p.energy.terms[0].alpha,
        lambda p: p.energy.terms[1].beta,
        lambda p: p.mesh.vertices,
        lambda p: p.loss.target,
    ],
    ids=["angle", "stretch", "thickness", "alpha", "beta", "rest vertices", "target"],
)
def test_gradient_in_every_trainable_array(where):
    problem = random_problem(1)
    gradient = where(GRADIENT(problem))
    array = where(problem)
    direction = jnp.asarray(np.random.default_rng(5).normal(size=array.shape))
    moved = lambda step: LOSS(eqx.tree_at(where, problem, array + step * direction))
    step = 1e-4
    central = (8 * (moved(step) - moved(-step)) - (moved(2 * step) - moved(-2 * step))) / (12 * step)
    assert np.isclose(float(jnp.vdot(gradient, direction)), float(central), rtol=1e-6, atol=1e-12)


LOSS = eqx.filter_jit(lambda p: p.evaluate()[0])
GRADIENT = eqx.filter_jit(eqx.filter_grad(lambda p: p.evaluate()[0]))


@pytest.mark.slow
def test_tangent_is_adjoint():
    problem = random_problem(2)
    angle = lambda p: p.actuation.top.angle
    loss = lambda a: eqx.tree_at(angle, problem, a).evaluate()[0]
    direction = jnp.asarray(np.random.default_rng(3).normal(size=MESH.n_faces))
    tangent = jax.jvp(loss, (angle(problem),), (direction,))[1]
    adjoint = jax.grad(loss)(angle(problem)) @ direction
    assert np.isclose(float(tangent), float(adjoint), rtol=1e-12, atol=1e-16)


@pytest.mark.slow
def test_hessian_vector_products_of_the_loss():
    problem = random_problem(2)
    angle = lambda p: p.actuation.top.angle
    gradient = jax.jit(jax.grad(lambda a: eqx.tree_at(angle, problem, a).evaluate()[0]))
    direction = jnp.asarray(np.random.default_rng(3).normal(size=MESH.n_faces))
    product = jax.jvp(gradient, (angle(problem),), (direction,))[1]
    step = 1e-4
    central = (gradient(angle(problem) + step * direction) - gradient(angle(problem) - step * direction)) / (2 * step)
    assert jnp.allclose(product, central, rtol=0, atol=1e-5 * jnp.abs(central).max())


def test_pose_is_that_nearest_to_the_start():
    equilibrium = random_problem(3)()
    moved = equilibrium.vertices - MESH.vertices
    assert jnp.abs(moved.mean(0)).max() < 1e-12
    assert jnp.abs(jnp.cross(MESH.vertices, equilibrium.vertices).sum(0)).max() < 1e-10


def test_loss_that_sees_the_motion_has_a_gradient_that_means_something():
    """The derivative of a vertex position itself, against finite differences: the pose is part of the answer."""
    problem = random_problem(4)
    angle = lambda p: p.actuation.top.angle
    position = eqx.filter_jit(lambda a: eqx.tree_at(angle, problem, a)().vertices[7, 1])
    direction = jnp.asarray(np.random.default_rng(3).normal(size=MESH.n_faces))
    tangent = jax.jvp(position, (angle(problem),), (direction,))[1]
    step = 1e-4
    central = (position(angle(problem) + step * direction) - position(angle(problem) - step * direction)) / (2 * step)
    assert np.isclose(float(tangent), float(central), rtol=1e-5)


def test_one_step_is_not_enough_and_says_so():
    equilibrium = random_problem(solver=sk.SparseNewton(max_steps=1))()
    assert not bool(equilibrium.converged) and not bool(equilibrium.stable)
    assert equilibrium.result == sk.RESULTS.nonlinear_max_steps_reached
    assert jnp.isfinite(equilibrium.vertices).all()


def test_nothing_is_compiled_for_new_angles():
    first, second = random_problem(5), random_problem(6)
    jax.block_until_ready(first().vertices)
    with jax.log_compiles(False), _count_compilations() as count:
        jax.block_until_ready(second().vertices)
    assert count[0] == 0


class _count_compilations:
    """Counts what JAX compiles while it is entered."""

    def __enter__(self):
        self.count = [0]
        jax.monitoring.register_event_duration_secs_listener(self._listen)
        return self.count

    def _listen(self, event, duration, **kwargs):
        self.count[0] += event == "/jax/core/compile/backend_compile_duration"

    def __exit__(self, *error):
        jax.monitoring.unregister_event_duration_listener(self._listen)


@pytest.mark.slow
def test_frozen_arrays_cost_no_derivative():
    problem = random_problem()
    spec = eqx.tree_at(lambda p: p.actuation.top.angle, jax.tree.map(lambda _: False, problem), replace=True)
    trained, frozen = eqx.partition(problem, spec)
    gradient = eqx.filter_grad(lambda t: eqx.combine(t, frozen).evaluate()[0])(trained)
    assert len(jax.tree.leaves(eqx.filter(gradient, eqx.is_array))) == 1


def test_loss_without_shape_does_not_relax():
    problem = random_problem(loss=sk.DirectorSmoothness())
    program = str(
        jax.make_jaxpr(lambda a: eqx.tree_at(lambda p: p.actuation.top.angle, problem, a).evaluate()[0])(
            problem.actuation.top.angle
        )
    )
    assert "while" not in program and "ffi_call" not in program


def test_relaxation_from_another_start():
    problem = random_problem(1)
    equilibrium = problem()
    again = problem(equilibrium)
    assert int(again.steps) <= 2 and jnp.allclose(again.vertices, equilibrium.vertices, atol=1e-10)


def test_vmap_over_designs():
    problem = random_problem()
    angles = jnp.asarray(np.random.default_rng(9).uniform(0, np.pi, (2, MESH.n_faces)))
    shape = lambda a: eqx.tree_at(lambda p: p.actuation.top.angle, problem, a)().vertices
    together = jax.lax.map(shape, angles)
    assert jnp.allclose(together, jnp.stack([shape(a) for a in angles]), atol=1e-10)


def test_folded_hinge_is_named():
    """A sin-form hinge driven past its range folds flat; the result says so and the edge is given."""
    hinge = sk.Mesh(np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0.0]]), np.array([[0, 1, 2], [1, 0, 3]]))
    curvature = jnp.broadcast_to(jnp.array([[0.0, 0.0], [0.0, 30.0]]), (2, 2, 2))
    problem = sk.InverseProblem(
        mesh=hinge,
        thickness=0.1,
        energy=sk.NeoHookean(bulk=1.0, shear=1.0) + sk.Bending(alpha=1.0, beta=1.0),
        actuation=sk.Prescribed(curvature=curvature),
        solver=sk.SparseNewton(max_steps=60),
    )
    equilibrium = problem()
    folded = equilibrium.result == sk.RESULTS.hinge_folded
    assert bool(equilibrium.converged) or bool(folded)
    if folded:
        assert int(equilibrium.worst_hinge) == int(jnp.argmax(hinge.edge_faces[:, 1] >= 0))


@pytest.mark.parametrize(
    ("form", "directors", "result"),
    [("sin", "average", "hinge_folded"), ("tan", "average", "hinge_pressed"), ("sin", "free", "hinge_pressed")],
)
def test_a_fold_is_laid_to_averaged_normals_only_where_there_are_some(form, directors, result):
    hinge = sk.Mesh(np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0.0]]), np.array([[0, 1, 2], [1, 0, 3]]))
    problem = sk.InverseProblem(
        mesh=hinge,
        thickness=0.1,
        energy=sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0, form=form, directors=directors),
        solver=sk.SparseNewton(max_steps=0),
    )
    turn = np.deg2rad(179.5)
    shut = hinge.vertices.at[3].set(jnp.array([0.5, -np.cos(turn), np.sin(turn)]))
    start = eqx.tree_at(lambda e: e.vertices, problem.unrelaxed(), shut)
    equilibrium = problem(start)
    assert not bool(equilibrium.converged)
    assert bool(equilibrium.result == getattr(sk.RESULTS, result))


def test_problem_without_a_loss_says_so():
    with pytest.raises(ValueError, match="no loss"):
        sk.InverseProblem(mesh=MESH, thickness=0.1, energy=ENERGY).evaluate()


def test_thickness_per_face_must_fit():
    with pytest.raises(ValueError, match=r"\(42,\).*80"):
        random_problem(thickness=jnp.ones(42))
    with pytest.raises(ValueError, match="face 3"):
        random_problem(thickness=jnp.ones(80).at[3].set(0.0))
