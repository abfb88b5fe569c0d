"""What a shape tells of its parameters, against finite differences, dense algebra and cases with known answers."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk
from shellkit._relaxation.rigid_modes import rigid_fields


# Compiling the derivative of a relaxation takes its time; the algebra has its own quick tests in test_directions.py.
pytestmark = pytest.mark.slow

MESH = sk.meshes.icosphere(subdivisions=1)
TOP, BOTTOM = "actuation.top.angle", "actuation.bottom.angle"


def angles(problem):
    return problem.actuation.top.angle, problem.actuation.bottom.angle


def teacher(stretch=1.1, seed=0):
    rng = np.random.default_rng(seed)
    return sk.InverseProblem(
        mesh=MESH,
        thickness=0.1,
        actuation=sk.Bilayer(
            *(sk.Nematic(jnp.asarray(rng.uniform(0, np.pi, MESH.n_faces)), jnp.asarray(stretch)) for _ in range(2))
        ),
        energy=sk.StVenantKirchhoff(alpha=1.0, beta=1.0) + sk.Bending(alpha=1.0, beta=1.0),
    )


PROBLEM = teacher()


@pytest.fixture(scope="module")
def found():
    return sk.identifiability(PROBLEM, where=angles)


@pytest.fixture(scope="module")
def relaxed(found):
    """The shapes after some changes of the 160 angles, one per row of a square matrix."""

    @jax.jit
    def shapes(moves):
        def shape(move):
            top, bottom = angles(PROBLEM)
            moved = eqx.tree_at(angles, PROBLEM, (top + move[:80], bottom + move[80:]))
            return moved(found.equilibrium).vertices.reshape(-1)

        return jax.lax.map(shape, moves)

    return lambda moves: np.asarray(shapes(jnp.asarray(moves)))


@pytest.fixture(scope="module")
def dense(found, relaxed):
    """The derivative by central differences of fourth order of relaxations, modulo rigid motions."""
    step = 2e-3
    ahead, behind, ahead_2, behind_2 = (relaxed(s * step * np.eye(160)) for s in (1, -1, 2, -2))
    jacobian = ((8 * (ahead - behind) - (ahead_2 - behind_2)) / (12 * step)).T
    basis = np.linalg.qr(np.asarray(rigid_fields(found.equilibrium.vertices)))[0]
    return (jacobian - basis @ (basis.T @ jacobian)) / np.sqrt(MESH.n_vertices)


def flat(result):
    return np.concatenate([np.asarray(result.directions[n]).reshape(-1, 80) for n in (TOP, BOTTOM)], axis=1)


def test_singular_values_are_those_of_finite_differences(found, dense):
    exact = np.linalg.svd(dense, compute_uv=False)
    assert np.allclose(found.singular_values[:126], exact, rtol=0, atol=1e-8 * exact[0])
    # The decomposition gives back the derivative itself.
    left = np.asarray(found.shapes).reshape(160, -1) / np.sqrt(MESH.n_vertices)
    whole = left.T @ (np.asarray(found.singular_values)[:, None] * flat(found))
    assert np.allclose(whole, dense, rtol=0, atol=1e-8 * exact[0])


def test_more_parameters_than_the_shape_can_tell(found):
    """160 angles and 126 coordinates, six of which are rigid motions: forty directions at least are never seen."""
    assert found.complete and len(found.singular_values) == 160
    assert found.rank(1e-10) <= 120 and float(found.singular_values[120]) < 1e-12
    directions = flat(found)
    assert np.allclose(directions @ directions.T, np.eye(160), atol=1e-12)
    fields = np.asarray(found.shapes)[:120].reshape(120, -1)
    assert np.allclose(fields @ fields.T / MESH.n_vertices, np.eye(120), atol=1e-10)
    assert np.abs(fields @ np.asarray(rigid_fields(found.equilibrium.vertices))).max() < 1e-9
    assert str(found).startswith("160 parameters, 126 coordinates")


def test_an_unseen_change_leaves_the_shape(found, relaxed):
    """Along the last direction the shape moves at second order only; along the first by its singular value."""
    step, largest = 1e-3, float(found.singular_values[0])
    start = found.equilibrium.vertices
    shapes = relaxed(step * np.where(np.isin(np.arange(160), [0, 159])[:, None], flat(found), 0.0)).reshape(160, -1, 3)
    moved = lambda row: float(
        jnp.sqrt(jnp.mean(jnp.sum((sk.Kabsch()(jnp.asarray(shapes[row]), start) - start) ** 2, axis=1)))
    )
    assert moved(159) < 10 * step**2 * largest
    assert moved(0) == pytest.approx(step * largest, rel=1e-2)


def test_changes_split_into_seen_and_unseen(found, dense):
    rng = np.random.default_rng(3)
    change = {TOP: rng.normal(size=80), BOTTOM: rng.normal(size=80)}
    together = np.concatenate([change[TOP], change[BOTTOM]])
    assert np.allclose(
        np.asarray(found.displacement(change)).reshape(-1),
        np.sqrt(MESH.n_vertices) * dense @ together,
        atol=1e-7,
    )
    everything, nothing = found.seen(change, 0.0), found.seen(change, np.inf)
    assert np.allclose(everything[TOP], change[TOP]) and np.allclose(nothing[TOP], 0)
    threshold = float(found.singular_values[50])
    seen = found.seen(change, threshold)
    rest = {name: change[name] - np.asarray(seen[name]) for name in change}
    moved = np.linalg.norm(found.displacement(rest)) / np.sqrt(MESH.n_vertices)
    assert moved <= threshold * np.sqrt(sum((r**2).sum() for r in rest.values()))
    # What is not named does not change.
    assert np.allclose(found.components({TOP: change[TOP]}), flat(found)[:, :80] @ change[TOP], atol=1e-12)


def test_posterior_is_that_of_the_normal_equations(found, dense):
    noise, prior = 1e-2, 0.5
    jacobian = np.sqrt(MESH.n_vertices) * dense
    exact = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian / noise**2 + np.eye(160) / prior**2)))
    posterior = found.posterior(noise, prior)
    assert np.allclose(np.concatenate([posterior[TOP], posterior[BOTTOM]]), exact, rtol=1e-6)
    assert np.allclose(found.posterior(1e6, prior)[TOP], prior)


def test_tolerance_is_the_spread_of_the_shape(found, dense):
    spread = 0.02
    exact = spread * np.sqrt(MESH.n_vertices * (dense**2).reshape(MESH.n_vertices, 3, -1).sum(axis=(1, 2)))
    assert np.allclose(found.tolerance(spread), exact, rtol=1e-7)


def test_angles_have_no_effect_without_a_stretch():
    result = sk.identifiability(teacher(stretch=1.0), where=angles)
    assert float(result.singular_values[0]) < 1e-14
    assert np.allclose(result.posterior(1e-3, 0.7)[TOP], 0.7)


def test_directors_have_no_heads(found):
    top, bottom = angles(PROBLEM)
    turned = eqx.tree_at(angles, PROBLEM, (top + jnp.pi, bottom - jnp.pi))
    result = sk.identifiability(turned, where=angles)
    assert np.allclose(result.singular_values, found.singular_values, rtol=0, atol=1e-10)


def test_scale_is_the_unit_of_a_parameter(found, dense):
    sizes = np.random.default_rng(0).uniform(0.1, 3.0, 80)
    result = sk.identifiability(PROBLEM, where=angles, scale={TOP: sizes})
    scaled = dense * np.concatenate([sizes, np.ones(80)])
    assert np.allclose(result.singular_values[:126], np.linalg.svd(scaled, compute_uv=False), rtol=0, atol=1e-8)
    change = {TOP: np.ones(80)}
    assert np.allclose(result.displacement(change), found.displacement(change), atol=1e-10)
    assert np.allclose(result.posterior(1e9)[TOP], sizes)


def test_leading_directions_of_a_large_problem(found):
    result = sk.identifiability(PROBLEM, where=angles, count=12)
    assert not result.complete and "12 largest" in str(result)
    assert np.allclose(result.singular_values, found.singular_values[:12], rtol=1e-6)
    # The same space, and the same tolerance from below.
    overlap = np.linalg.svd(flat(result)[:8] @ flat(found)[:12].T, compute_uv=False)
    assert np.allclose(overlap, 1, atol=1e-8)
    assert (np.asarray(result.tolerance()) <= np.asarray(found.tolerance()) + 1e-12).all()


def test_what_does_not_fit_is_refused(found):
    with pytest.raises(ValueError, match="count=500"):
        sk.identifiability(PROBLEM, where=angles, count=500, equilibrium=found.equilibrium)
    with pytest.raises(ValueError, match="scale names 'angle'"):
        sk.identifiability(PROBLEM, where=angles, scale={"angle": 1.0}, equilibrium=found.equilibrium)
    with pytest.raises(ValueError, match="did not converge"):
        bad = eqx.tree_at(lambda e: e.converged, found.equilibrium, jnp.array(False))
        sk.identifiability(PROBLEM, where=angles, equilibrium=bad)
    with pytest.raises(ValueError, match=r"change names 'angle'"):
        found.components({"angle": np.ones(80)})
    with pytest.raises(ValueError, match=r"has shape \(3,\)"):
        found.components({TOP: np.ones(3)})
