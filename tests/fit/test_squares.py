"""Second-order training against problems solved on paper, and the Jacobian of a real shell against finite
differences."""

import shutil
import warnings
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
import pytest
from jax.flatten_util import ravel_pytree

import shellkit as sk
from shellkit._fit.choices import Refuse
from shellkit._fit.design import split
from shellkit._fit.fit import fit
from shellkit._fit.methods.from_optimistix import from_optimistix
from shellkit._fit.methods.gauss_newton import Model, Plan, dense_model, krylov_model
from shellkit._fit.methods.least_squares import jacobian
from shellkit._fit.methods.rules import DoglegRadius, NielsenDamping, StepHalving


LEVENBERG = optx.LevenbergMarquardt(rtol=1e-9, atol=1e-9)
KRYLOV = lx.Normal(lx.CG(rtol=1e-10, atol=0.0, max_steps=40))


class Curve(eqx.Module):
    """Fits exp(a x) b through given heights: residuals that are not linear in what is trained, zero at the optimum if
    the heights lie on such a curve. No relaxation converges where a is above `limit`."""

    actuation: jax.Array
    x: jax.Array
    heights: jax.Array
    limit: jax.Array
    wrong: bool = eqx.field(static=True, default=False)

    def residuals(self, equilibrium):
        a, b = self.actuation
        return (b * jnp.exp(a * self.x) - self.heights) * (2.0 if self.wrong else 1.0)

    def objective(self, start=None):
        loss = jnp.sum((self.actuation[1] * jnp.exp(self.actuation[0] * self.x) - self.heights) ** 2)
        shape = _Relaxed(
            vertices=self.actuation,
            gradient_norm=jnp.asarray(1e-12),
            steps=jnp.asarray(7 if start is None else 3),
            converged=self.actuation[0] <= self.limit,
            stable=jnp.asarray(True),
        )
        return loss, ({"Distance": loss}, shape)


class Snap(eqx.Module):
    """Residuals that fall as exp(-a), and a new one that appears beyond a = 1.45, where a shell would have snapped."""

    actuation: jax.Array

    def residuals(self, equilibrium):
        a = self.actuation
        return jnp.stack([4 * jnp.exp(-a), jnp.where(a > 1.45, 2 * jnp.exp(2 - a), 0.0)])

    def objective(self, start=None):
        loss = jnp.sum(self.residuals(None) ** 2)
        shape = _Relaxed(self.actuation, jnp.zeros(()), jnp.asarray(1), jnp.asarray(True), jnp.asarray(True))
        return loss, ({"Distance": loss}, shape)


class _Relaxed(eqx.Module):
    vertices: jax.Array
    gradient_norm: jax.Array
    steps: jax.Array
    converged: jax.Array
    stable: jax.Array
    directors: None = None
    result: str = eqx.field(static=True, default="stand-in")


KEPT = Path(__file__).parent / "kept" / "levenberg"
X = np.linspace(0.0, 1.0, 9)
trained = lambda p: p.actuation


def curve(noise=0.0, start=(0.0, 1.0), **parts):
    heights = 0.7 * np.exp(1.3 * X) + noise * np.cos(9 * X)
    given: dict = {"limit": jnp.asarray(jnp.inf)} | parts
    return Curve(jnp.array(start), jnp.asarray(X), jnp.asarray(heights), **given)


@pytest.mark.parametrize("make", [optx.LevenbergMarquardt, optx.GaussNewton, optx.Dogleg])
@pytest.mark.parametrize("linear_solver", [None, KRYLOV], ids=["dense", "krylov"])
def test_solvers_reach_the_exact_optimum(make, linear_solver):
    options = {} if linear_solver is None else {"linear_solver": linear_solver}
    result = fit(curve(), make(rtol=1e-9, atol=1e-9, **options), steps=40, where=trained)
    np.testing.assert_allclose(result.problem.actuation, [1.3, 0.7], rtol=1e-9)
    assert result.stopped == "converged" and result.best_loss < 1e-24
    assert (np.diff(result.history["loss"]) < 0).all()


def test_convergence_is_quadratic_where_the_residuals_vanish():
    result = fit(curve(), optx.GaussNewton(rtol=1e-12, atol=1e-12), steps=12, where=trained)
    error = np.sqrt(result.history["loss"])
    error = error[(error < 1e-1) & (error > 1e-12)]
    # Each error is below a constant times the square of the one before, which no linear rate is.
    assert len(error) >= 2 and (error[1:] < 3 * error[:-1] ** 2 + 1e-13).all()


def test_the_optimum_of_residuals_that_do_not_vanish():
    problem = curve(noise=0.1)
    result = fit(problem, LEVENBERG, steps=60, where=trained)
    gradient = jax.grad(lambda p: p.objective()[0])(result.problem).actuation
    np.testing.assert_allclose(gradient, 0, atol=1e-8)
    assert result.history["gradient_norm"][0] == pytest.approx(
        float(jnp.linalg.norm(jax.grad(lambda p: p.objective()[0])(problem).actuation)), rel=1e-10
    )


def test_only_designs_that_lower_the_loss_are_accepted():
    result = fit(curve(start=(-3.0, 3.0)), LEVENBERG, steps=60, where=trained)
    assert (np.diff(result.history["loss"]) < 0).all()
    np.testing.assert_allclose(result.problem.actuation, [1.3, 0.7], rtol=1e-8)
    assert set(result.history) >= {"control", "products", "refused"} and "update_scale" not in result.history


@pytest.mark.parametrize("make", [optx.LevenbergMarquardt, optx.GaussNewton, optx.Dogleg])
def test_a_rise_that_is_allowed_leads_over_an_edge(make):
    run = lambda **options: fit(Snap(jnp.zeros(())), make(rtol=1e-9, atol=1e-9), steps=30, where=trained, **options)
    # At the edge the loss is 16 exp(-2.9); the first step beyond it, at a = 2, doubles that of the step before.
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "fit: stopped", UserWarning)
        assert run().best_loss >= 16 * np.exp(-2.9) and run(refuse=Refuse(rise=0.5)).best_loss >= 16 * np.exp(-2.9)
    assert run(refuse=Refuse(rise=2.0)).best_loss < 1e-6


def test_failed_relaxations_are_refused_with_more_damping():
    # The first, nearly undamped, step goes to a = 7.4; the optimum itself is allowed.
    problem = curve(start=(0.0, 0.2), limit=jnp.asarray(4.0))
    with pytest.warns(UserWarning, match="was refused, as the relaxation did not converge"):
        result = fit(problem, LEVENBERG, steps=60, where=trained)
    assert result.history["refused"].sum() > 0 and result.history["converged"].all()
    np.testing.assert_allclose(result.problem.actuation, [1.3, 0.7], rtol=1e-8)


def test_bounds():
    inside = [sk.Bounds(trained, jnp.array([-1.0, 0.0]), jnp.array([3.0, 2.0]))]
    result = fit(curve(), LEVENBERG, steps=60, where=trained, bounds=inside)
    np.testing.assert_allclose(result.problem.actuation, [1.3, 0.7], rtol=1e-8)
    tight = [sk.Bounds(trained, jnp.array([-1.0, 0.0]), jnp.array([1.0, 2.0]))]
    limited = fit(curve(), LEVENBERG, steps=30, where=trained, bounds=tight)
    assert 0.9 < float(limited.problem.actuation[0]) < 1.0


def test_resumes_exactly(tmp_path):
    problem = curve(noise=0.1, start=(-3.0, 3.0))
    straight = fit(problem, LEVENBERG, steps=9, where=trained)
    for steps in (4, 9):
        resumed = fit(problem, LEVENBERG, steps=steps, where=trained, checkpoint=tmp_path / "run")
    for column in ("loss", "control", "refused", "products"):
        np.testing.assert_array_equal(resumed.history[column], straight.history[column])
    with pytest.raises(ValueError, match="another fit"):
        fit(problem, optx.Dogleg(1e-9, 1e-9, linear_solver=KRYLOV), steps=9, where=trained, checkpoint=tmp_path / "run")


def test_a_checkpoint_of_the_last_release_is_resumed(tmp_path):
    """Written after four steps, before methods were public."""
    problem = curve(noise=0.1, start=(-3.0, 3.0))
    shutil.copy(KEPT, tmp_path / "run")
    resumed = fit(problem, LEVENBERG, steps=9, where=trained, checkpoint=tmp_path / "run")
    straight = fit(problem, LEVENBERG, steps=9, where=trained)
    assert resumed.history["seconds"][3] == sk.load_checkpoint(KEPT, problem).history["seconds"][3]
    for column in ("loss", "control", "refused", "products"):
        np.testing.assert_allclose(resumed.history[column], straight.history[column], rtol=1e-6)


@pytest.mark.parametrize(
    ("theirs", "ours"),
    [
        (optx.LevenbergMarquardt(1e-9, 1e-9), sk.LevenbergMarquardt(1e-9, 1e-9)),
        (optx.GaussNewton(1e-9, 1e-8, norm=optx.rms_norm), sk.GaussNewton(1e-9, 1e-8, norm=optx.rms_norm)),
        (
            optx.LevenbergMarquardt(1e-9, 1e-9, linear_solver=KRYLOV),
            sk.LevenbergMarquardt(1e-9, 1e-9, jacobian="krylov", products=40, accuracy=1e-10),
        ),
        (optx.Dogleg(1e-9, 1e-9, linear_solver=lx.SVD()), sk.Dogleg(1e-9, 1e-9, jacobian="dense")),
    ],
    ids=["levenberg", "gauss", "krylov", "dogleg"],
)
def test_solvers_of_optimistix_stand_for_ours(theirs, ours):
    assert from_optimistix(theirs, stacklevel=1) == ours
    problem = curve(noise=0.1, start=(-3.0, 3.0))
    one, other = (fit(problem, method, steps=6, where=trained) for method in (theirs, ours))
    for column in ("loss", "control", "refused", "products"):
        np.testing.assert_array_equal(one.history[column], other.history[column])


@pytest.mark.parametrize(
    ("solver", "named"),
    [
        (optx.LevenbergMarquardt(1e-9, 1e-9, verbose=True), "LevenbergMarquardt .* not used: verbose"),
        (eqx.tree_at(lambda s: s.search, LEVENBERG, optx.LearningRate(0.5)), "not used: search"),
        (optx.Dogleg(1e-9, 1e-9, linear_solver=lx.Normal(lx.CG(1e-3, 1e-6))), "Dogleg .* not used: linear_solver.atol"),
        (optx.GaussNewton(1e-9, 1e-9, linear_solver=lx.GMRES(1e-3, 1e-6)), r"not used: linear_solver \(GMRES\)"),
    ],
    ids=["verbose", "search", "tolerance", "linear solver"],
)
def test_what_is_ignored_of_them_is_named(solver, named):
    with pytest.warns(UserWarning, match=named):
        fit(curve(), solver, steps=1, where=trained)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: sk.LevenbergMarquardt(rtol=-1.0), "rtol and atol must not be negative"),
        (lambda: sk.GaussNewton(products=0), "GaussNewton: products must be a whole number, at least 1; got 0"),
        (lambda: sk.Dogleg(accuracy=-1.0), "accuracy must not be negative"),
        (lambda: sk.NielsenDamping(first=0.0), "first must be positive"),
        (lambda: sk.NielsenDamping(decay=1.5), r"decay must be in \(0, 1\]"),
    ],
)
def test_numbers_out_of_range(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_the_damping_is_a_part():
    """Its first value is a number times the largest eigenvalue of JᵀJ, and follows the gain from there."""
    jacobian = np.stack([X * 1.0, np.ones_like(X)], axis=1)  # of b exp(a x) at a = 0, b = 1
    largest = np.linalg.eigvalsh(jacobian.T @ jacobian).max()
    for damping in (sk.NielsenDamping(), sk.NielsenDamping(first=10.0)):
        history = fit(curve(), sk.LevenbergMarquardt(damping=damping), steps=2, where=trained).history
        assert history["control"][1] == pytest.approx(damping.first * largest, rel=1e-9)


def test_residuals_that_do_not_belong_to_the_loss():
    with pytest.raises(ValueError, match="residuals sum to"):
        fit(curve(wrong=True), LEVENBERG, steps=2, where=trained)


def test_solvers_and_problems_that_do_not_fit(make_quadratic, angle):
    with pytest.raises(ValueError, match="a method residuals"):
        fit(make_quadratic(), LEVENBERG, steps=2, where=angle)
    with pytest.raises(ValueError, match=r"optimistix\.LevenbergMarquardt"):
        fit(curve(), optx.BestSoFarLeastSquares(LEVENBERG), steps=2, where=trained)


def a_model(m, n, krylov, tolerance=0.0, products=200, damping=0.0):
    keys = jax.random.split(jax.random.key(m * n), 2)
    jacobian, residuals = jax.random.normal(keys[0], (m, n)), jax.random.normal(keys[1], (m,))
    push, pull = lambda p: jacobian @ p, lambda u: jacobian.T @ u
    if krylov:
        plan = Plan(False, products, tolerance)
        slope, model = krylov_model(push, pull, residuals, n, plan, jnp.asarray(damping))
    else:
        slope, model = dense_model(push, pull, residuals, n)
    np.testing.assert_allclose(slope, jacobian.T @ residuals, rtol=1e-9, atol=1e-12)
    return np.asarray(jacobian), np.asarray(residuals), model


@pytest.mark.parametrize("krylov", [False, True], ids=["dense", "krylov"])
@pytest.mark.parametrize(("m", "n"), [(40, 12), (12, 40)])
def test_steps_of_the_model_are_those_of_the_whole_jacobian(krylov, m, n):
    jacobian, residuals, model = a_model(m, n, krylov)
    for damping in (1e-3, 1.0, 100.0):
        coefficients = NielsenDamping().step(model, damping)
        step = coefficients @ np.asarray(model.directions)
        exact = np.linalg.solve(jacobian.T @ jacobian + damping * np.eye(n), -jacobian.T @ residuals)
        np.testing.assert_allclose(step, exact, rtol=1e-8, atol=1e-10)
        promised = residuals @ residuals - np.sum((residuals + jacobian @ exact) ** 2)
        assert model.reduction(coefficients) == pytest.approx(promised, rel=1e-8)
    newton = StepHalving().step(model, 1.0) @ np.asarray(model.directions)
    np.testing.assert_allclose(newton, -np.linalg.pinv(jacobian) @ residuals, rtol=1e-8, atol=1e-10)


def test_a_space_cut_short_is_accurate_for_its_damping():
    jacobian, residuals, model = a_model(60, 50, True, tolerance=1e-3, damping=30.0)
    step = NielsenDamping().step(model, 30.0) @ np.asarray(model.directions)
    left = jacobian.T @ (jacobian @ step + residuals) + 30.0 * step
    assert int(model.products) < 40
    assert np.linalg.norm(left) <= 1.001e-3 * np.linalg.norm(jacobian.T @ residuals)


def test_the_dogleg_has_the_length_it_is_given():
    model = Model(jnp.eye(3), jnp.array([3.0, 1.0, 0.1]), jnp.array([1.0, 1.0, 1.0]), jnp.asarray(3, jnp.int32))
    newton, rule = np.array([1 / 3, 1.0, 10.0]), DoglegRadius()
    for length in (1e-3, 0.3, 1.0, 5.0):
        assert np.linalg.norm(rule.step(model, length)) == pytest.approx(length)
    np.testing.assert_allclose(rule.step(model, 11.0), newton)
    # At first along the steepest descent.
    short = rule.step(model, 1e-3)
    np.testing.assert_allclose(short / np.linalg.norm(short), np.array([3, 1, 0.1]) / np.linalg.norm([3, 1, 0.1]))


both = lambda p: (p.actuation.top.angle, p.actuation.bottom.angle)


def shell(seed, loss=None):
    mesh = sk.meshes.icosphere(subdivisions=0)
    angles = 0.4 * jax.random.normal(jax.random.key(seed), (2, mesh.n_faces))
    return sk.InverseProblem(
        mesh=mesh,
        thickness=0.1,
        actuation=sk.Bilayer(*(sk.Nematic(angle=angle, stretch=1.1) for angle in angles)),
        energy=sk.StVenantKirchhoff(alpha=1.0, beta=1.0) + sk.Bending(alpha=1.0, beta=1.0),
        loss=loss,
    )


@eqx.filter_jit
def relaxed(design, values):
    problem = design.problem(values)
    loss, (_, equilibrium) = problem.objective()
    return loss, equilibrium, problem.loss.residuals(equilibrium, problem.actuation)


@eqx.filter_jit
def products(design, values, equilibrium, direction, weights):
    residuals, push, pull, _, _ = jacobian(design, values, equilibrium)
    return residuals, push(direction), pull(weights), jax.vmap(push)(jnp.stack([direction, 2 * direction]))


def test_products_are_those_of_the_relaxed_residuals():
    target = sk.meshes.icosphere(subdivisions=0).vertices * jnp.array([0.9, 1.0, 1.2])
    design, values = split(shell(0, sk.VertexDistance(target) + 2.0 * sk.Sphericity() + sk.DirectorSmoothness()), both)
    flat, unravel = ravel_pytree(values)
    loss, equilibrium, found = relaxed(design, values)
    direction = jax.random.normal(jax.random.key(5), flat.shape)
    weights = jax.random.normal(jax.random.key(6), found.shape)
    residuals, image, force, several = products(design, values, equilibrium, direction, weights)
    np.testing.assert_allclose(residuals, found, atol=1e-10)
    assert float(jnp.sum(residuals**2)) == pytest.approx(float(loss), rel=1e-9)
    assert float(weights @ image) == pytest.approx(float(force @ direction), rel=1e-9)
    np.testing.assert_allclose(several, jnp.stack([image, 2 * image]), rtol=1e-9, atol=1e-13)
    h = 1e-4
    ahead, behind = (relaxed(design, unravel(flat + side * h * direction))[2] for side in (1, -1))
    np.testing.assert_allclose(image, (ahead - behind) / (2 * h), atol=1e-6 * float(jnp.max(jnp.abs(image))))


@pytest.mark.slow
def test_a_teacher_is_found():
    teacher = shell(0)
    problem = shell(0, sk.VertexDistance(teacher().vertices))
    problem = eqx.tree_at(both, problem, replace_fn=lambda angle: angle + 0.05)
    result = fit(problem, LEVENBERG, steps=15, where=both)
    assert result.best_loss < 1e-14 < 1e-6 < result.history["loss"][0]


def test_losses_that_are_no_sums_of_squares():
    problem = shell(0, sk.DirectorSmoothness() + Foreign())
    with pytest.raises(ValueError, match="Foreign gives no residuals"):
        fit(problem, LEVENBERG, steps=2, where=both)


class Foreign(sk.Loss):
    @property
    def needs_shape(self):
        return False

    def __call__(self, equilibrium, actuation):
        return jnp.sum(equilibrium.mesh.vertices)
