"""Actuations: exact metrics, symmetries, ramps and refusals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk


MESH = sk.meshes.icosphere(subdivisions=1)
REST = sk.RestShape.of(MESH, jnp.asarray(0.1), "sin")
ANGLES = jnp.asarray(np.random.default_rng(0).uniform(0, np.pi, MESH.n_faces))


def in_space(metric):
    """Metrics of faces as stretches in their orthonormal frames: eigenvalues of g0^-1 g."""
    return np.sqrt(
        np.sort(np.linalg.eigvals(np.linalg.inv(np.asarray(REST.metric)) @ np.asarray(metric)).real, axis=-1)
    )


def test_nematic_stretches_along_its_director():
    metric = sk.Nematic(ANGLES, 1.3)(REST).metric
    assert np.allclose(in_space(metric), [1 / 1.3, 1.3], rtol=1e-12)
    assert np.allclose(np.linalg.det(metric), np.linalg.det(REST.metric), rtol=1e-12)
    # The squared length of the director itself, in edge coordinates.
    e1, e2 = sk.face_frames(MESH.vertices, MESH)
    d = np.cos(ANGLES)[:, None] * e1 + np.sin(ANGLES)[:, None] * e2
    a, b, c = np.moveaxis(np.asarray(MESH.vertices)[np.asarray(MESH.faces)], 1, 0)
    basis = np.stack([b - a, c - a], axis=-1)
    coordinates = np.einsum("fij,fj->fi", np.linalg.pinv(basis), d)
    assert np.allclose(np.einsum("fi,fij,fj->f", coordinates, metric, coordinates), 1.3**2, rtol=1e-12)


def test_nematic_is_headless_and_trivial_at_one():
    assert jnp.allclose(sk.Nematic(ANGLES, 1.3)(REST).metric, sk.Nematic(ANGLES + jnp.pi, 1.3)(REST).metric, atol=1e-14)
    assert jnp.allclose(sk.Nematic(ANGLES, 1.0)(REST).metric, REST.metric, atol=1e-15)
    assert jnp.allclose(
        sk.Nematic(ANGLES, 1 / 1.3)(REST).metric, sk.Nematic(ANGLES + jnp.pi / 2, 1.3)(REST).metric, atol=1e-14
    )


def test_growth():
    assert np.allclose(sk.IsotropicGrowth(1.2)(REST).metric, 1.44 * REST.metric, rtol=1e-14)
    per_face = jnp.linspace(0.8, 1.2, MESH.n_faces)
    assert np.allclose(
        sk.IsotropicGrowth(per_face)(REST).metric, per_face[:, None, None] ** 2 * REST.metric, rtol=1e-14
    )
    assert np.allclose(in_space(sk.OrthotropicGrowth(ANGLES, 1.4, 0.9)(REST).metric), [0.9, 1.4], rtol=1e-12)
    assert jnp.allclose(sk.OrthotropicGrowth(ANGLES, 1.3, 1 / 1.3)(REST).metric, sk.Nematic(ANGLES, 1.3)(REST).metric)


def test_bilayer_is_mean_and_difference():
    top, bottom = sk.Nematic(ANGLES, 1.3), sk.IsotropicGrowth(1.1)
    both = sk.Bilayer(top, bottom)(REST)
    g_top, g_bottom = top(REST).metric, bottom(REST).metric
    assert jnp.allclose(both.metric, (g_top + g_bottom) / 2)
    assert jnp.allclose(both.curvature, REST.curvature + 3 / (4 * 0.1) * (g_top - g_bottom))
    same = sk.Bilayer(top, top)(REST)
    assert jnp.allclose(same.metric, g_top) and jnp.allclose(same.curvature, REST.curvature)


def test_timoshenko_strip():
    """A flat bilayer with strains ±e/2 bends to 3 e / (2 h): b_r over the metric."""
    strip = sk.meshes.rectangle(1.0, 0.3, cells=(8, 3))
    rest = sk.RestShape.of(strip, jnp.asarray(0.01), "sin")
    strain = 1e-3
    both = sk.Bilayer(sk.IsotropicGrowth(1 + strain / 2), sk.IsotropicGrowth(1 - strain / 2))(rest)
    curvature = np.linalg.inv(both.metric) @ np.asarray(both.curvature)
    assert np.allclose(curvature, 1.5 * strain / 0.01 * np.eye(2), rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize(
    "actuation",
    [
        sk.Nematic(ANGLES, 1.3),
        sk.IsotropicGrowth(1.3),
        sk.OrthotropicGrowth(ANGLES, 1.3, 0.9),
        sk.Bilayer(sk.Nematic(ANGLES, 1.3), sk.Passive()),
        sk.Prescribed(1.5 * REST.metric, 0.5 * REST.curvature),
        sk.Passive(),
    ],
    ids=lambda a: type(a).__name__,
)
def test_ramp_starts_at_rest_and_ends_at_the_whole(actuation):
    for progress, expected in ((0.0, REST), (1.0, actuation(REST))):
        found = actuation.at(progress)(REST)
        assert jnp.allclose(found.metric, expected.metric, atol=1e-14)
        assert jnp.allclose(found.curvature, expected.curvature, atol=1e-13)


def test_own_sheet_in_a_bilayer_ramps():
    class Crumple(sk.SheetActuation):
        """A user's own sheet."""

        def actuated_metric(self, metric):
            return 0.81 * metric

    half = sk.Bilayer(Crumple(), sk.Passive()).at(0.5)(REST)
    assert jnp.allclose(half.metric, (0.5 * (1 + 0.81) + 1) / 2 * REST.metric)


def test_director_fields():
    assert len(sk.Bilayer(sk.Nematic(ANGLES, 1.1), sk.OrthotropicGrowth(ANGLES, 1.1, 1.0)).director_fields()) == 2
    assert sk.Passive().director_fields() == ()


@pytest.mark.parametrize(
    "actuation, words",
    [
        (sk.Nematic(ANGLES[:42], 1.1), ["42", "80"]),
        (sk.Nematic(ANGLES.at[7].set(jnp.nan), 1.1), ["angle", "7"]),
        (sk.IsotropicGrowth(jnp.ones(80).at[5].set(-1.0)), ["stretch", "5"]),
        (sk.Prescribed(metric=-REST.metric), ["metric", "positive definite"]),
        (sk.Prescribed(curvature=jnp.zeros((3, 2, 2))), ["curvature", "80"]),
    ],
)
def test_bad_actuations_are_refused(actuation, words):
    with pytest.raises(ValueError) as error:
        actuation.check(MESH)
    assert all(word in str(error.value) for word in words), str(error.value)


def lengths_of(metric, mesh):
    """Squared rest lengths of the sides of every face, by the side's number: opposite a, b, c."""
    g = np.asarray(metric)
    return np.stack([g[:, 0, 0] - 2 * g[:, 0, 1] + g[:, 1, 1], g[:, 1, 1], g[:, 0, 0]], axis=1)


def test_faces_that_share_rest_lengths_have_their_mean():
    """A little actuated, every edge gets the mean of what its two faces ask for; those of a rim keep theirs."""
    mesh = sk.meshes.rectangle(1.0, 0.8, cells=(5, 4), diagonals="jittered")
    angles = jnp.asarray(np.random.default_rng(1).uniform(0, np.pi, mesh.n_faces))
    own = sk.Nematic(angle=angles, stretch=1.001)(sk.RestShape.of(mesh, jnp.asarray(0.1), "sin"))
    shared = own.sharing_edges(mesh)
    asked, got = lengths_of(own.metric, mesh), lengths_of(shared.metric, mesh)
    total, faces = np.zeros(mesh.n_edges), np.zeros(mesh.n_edges)
    np.add.at(total, mesh.face_edges, asked)
    np.add.at(faces, mesh.face_edges, 1)
    assert np.abs(asked / got - 1).max() > 1e-3
    assert np.allclose(got, (total / faces)[np.asarray(mesh.face_edges)], rtol=1e-8, atol=0)
    assert shared.curvature is own.curvature and shared.thickness is own.thickness
    # Faces that agree already, as those of any surface and of any growth of it, are left alone.
    metric = 1.3 * sk.first_form(MESH.vertices * jnp.array([1.0, 0.7, 1.2]), MESH)
    curved = sk.RestShape(metric, None, jnp.ones(MESH.n_faces))
    assert jnp.allclose(curved.sharing_edges(MESH).metric, metric, rtol=0, atol=1e-15)


@pytest.mark.parametrize("stretch", [0.3, 3.0])
def test_shared_rest_lengths_make_triangles_however_strong_the_actuation(stretch):
    rest = sk.Nematic(ANGLES, stretch)(REST)
    plain = lengths_of(rest.metric, MESH)
    mean = 0.5 * (plain + plain.reshape(-1)[np.asarray(MESH.twins)])
    a, b, c = np.sqrt(mean).T
    assert ((a + b - c) * (b + c - a) * (c + a - b) < 0).any()  # the mean lengths alone do not
    shared, slope = jax.jvp(lambda s: sk.Nematic(ANGLES, s)(REST).sharing_edges(MESH).metric, (stretch,), (1.0,))
    assert (np.linalg.eigvalsh(shared) > 0).all() and np.isfinite(slope).all()


def test_rest_lengths_are_shared_where_asked_for():
    def metric(actuation, **changes):
        return sk.InverseProblem(MESH, 0.1, sk.StVenantKirchhoff(1.0, 1.0), actuation, **changes).rest_shape().metric

    nematic = sk.Nematic(ANGLES, 1.1)
    shared = nematic(REST).sharing_edges(MESH).metric
    assert jnp.array_equal(metric(nematic), nematic(REST).metric)
    assert jnp.array_equal(metric(nematic, rest_lengths="shared"), shared)
    assert jnp.array_equal(metric(sk.Passive(), rest_lengths="shared"), REST.metric)
    with pytest.raises(ValueError, match="rest_lengths"):
        metric(nematic, rest_lengths="both")
