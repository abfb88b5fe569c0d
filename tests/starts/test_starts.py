"""Designs to start from: the exact inverse of a bilayer, the nematic ones nearest to it, and what is feasible."""

import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk


MESH = sk.meshes.icosphere(subdivisions=1)
H = 0.1
RNG = np.random.default_rng(0)
TARGET = MESH.vertices * jnp.array([0.9, 1.0, 1.2]) + 0.02 * RNG.normal(size=MESH.vertices.shape)
ENERGY = sk.StVenantKirchhoff(alpha=1.0, beta=0.7) + sk.Bending(alpha=1.0, beta=0.7)


def problem(actuation, mesh=MESH, thickness=H):
    return sk.InverseProblem(mesh=mesh, thickness=thickness, energy=ENERGY, actuation=actuation)


@pytest.mark.parametrize("varying", [False, True])
def test_exact_inverse_has_no_energy_at_the_target(varying):
    thickness = jnp.asarray(RNG.uniform(0.05, 0.15, MESH.n_faces)) if varying else H
    start = sk.bilayer_inverse(MESH, TARGET, thickness)
    designed = problem(start, thickness=thickness)
    assert abs(float(designed.total_energy(TARGET))) < 1e-25
    rest = designed.rest_shape()
    assert jnp.allclose(rest.metric, sk.first_form(TARGET, MESH), rtol=0, atol=1e-14)
    assert jnp.allclose(rest.curvature, sk.second_form(TARGET, MESH), rtol=0, atol=1e-12)


def test_exact_inverse_relaxes_to_the_target():
    equilibrium = problem(sk.bilayer_inverse(MESH, TARGET, H))()
    assert bool(equilibrium.converged)
    assert jnp.allclose(sk.Kabsch()(equilibrium.vertices, TARGET), TARGET, atol=1e-9)


def test_a_sheet_rolls_up():
    """Curvature κ about y: the top needs the squared stretch 1 + 2hκ/3 along x, the bottom 1 - 2hκ/3: up to 3/2."""
    sheet = sk.meshes.rectangle(1.0, 0.3, cells=(40, 2))
    x, y = np.asarray(sheet.vertices)[:, :2].T
    for kappa, possible in ((2.0, True), (14.0, True), (16.0, False)):
        # Vertices on a circle, at chords of the length of the edges; outward normals are the sheet's.
        turn = 2 * np.arcsin(kappa / 80) * 40
        rolled = np.column_stack([np.sin(turn * x) / kappa, y, (np.cos(turn * x) - 1) / kappa])
        report = sk.feasibility(sheet, jnp.asarray(rolled), H)
        inner = (np.asarray(sheet.vertices)[np.asarray(sheet.faces), 0].min(1) > 0.05) & (
            np.asarray(sheet.vertices)[np.asarray(sheet.faces), 0].max(1) < 0.95
        )
        bend = np.asarray(report.bend)[inner]
        assert np.allclose(bend, H * kappa, rtol=0.03), (bend, kappa)
        assert report.possible == possible
        if possible:
            needed = np.sqrt(1 + 2 / 3 * H * kappa * np.array([1, -1]))
            assert np.allclose(np.asarray(report.top)[inner].max(1), needed[0], rtol=0.03)
            assert np.allclose(np.asarray(report.bottom)[inner].min(1), needed[1], rtol=0.15)
            sk.bilayer_inverse(sheet, jnp.asarray(rolled), H)
        else:
            assert np.isnan(report.bottom).any() and "impossible" in str(report)
            with pytest.raises(ValueError, match="bend too sharply"):
                sk.bilayer_inverse(sheet, jnp.asarray(rolled), H)


def test_feasibility_of_a_swollen_sphere():
    """A sphere of twice the size: b = 2 b0 while g = 4 g0, so the layers need 4 g0 ± (2h/3) b0."""
    report = sk.feasibility(MESH, 2.0 * MESH.vertices, H)
    b = np.linalg.inv(sk.first_form(MESH.vertices, MESH)) @ np.asarray(sk.second_form(MESH.vertices, MESH))
    kappa = np.sort(np.linalg.eigvals(b).real, axis=1)[:, ::-1]
    assert np.allclose(report.top, np.sqrt(4 + 2 * H / 3 * kappa), rtol=1e-12)
    assert np.allclose(report.bottom, np.sqrt(4 - 2 * H / 3 * kappa[:, ::-1]), rtol=1e-12)
    assert np.allclose(report.bend, H * kappa.max(1) / 4, rtol=1e-12)
    assert report.possible and report.within(1.9, 2.1) == 1.0 and report.within(0.9, 1.1) == 0.0
    assert report.nematic(1.1) == 0.0 and report.range[0] < 2 < report.range[1]
    assert len(str(report).splitlines()) == 4


def test_nematic_start_recovers_a_nematic_bilayer():
    """Where the exact layers are nematic themselves, the projection gives back angles and stretches."""
    angles = jnp.asarray(RNG.uniform(-1.5, 1.5, (2, MESH.n_faces)))
    stretches = jnp.asarray(RNG.uniform(1.05, 1.2, (2, MESH.n_faces)))
    # Layers are given, so the forms are put in by hand: the target only serves for its shape.
    from shellkit._starts import inverse
    from shellkit._starts.layers import LayerMetrics

    rest = sk.RestShape.of(MESH, jnp.asarray(H), None)
    layers = [sk.Nematic(a, s).actuated_metric(rest.metric) for a, s in zip(angles, stretches, strict=True)]
    made = LayerMetrics(rest.metric, *layers, jnp.zeros(MESH.n_faces))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(inverse, "layer_metrics", lambda *_: made)
        free = sk.nematic_start(MESH, TARGET, H)
        cold = sk.nematic_start(MESH, TARGET, H, stretch=0.9)
    for found, other, angle, stretch in zip(
        (free.top, free.bottom), (cold.top, cold.bottom), angles, stretches, strict=True
    ):
        assert jnp.allclose(jnp.sin(found.angle - angle), 0.0, atol=1e-12)
        assert jnp.allclose(found.stretch, stretch, rtol=1e-12)
        # A material that shrinks along its director has it across.
        assert jnp.allclose(jnp.cos(other.angle - angle), 0.0, atol=1e-12)
        assert float(other.stretch) == 0.9


def test_nematic_start_is_the_nearest():
    """No other angle or stretch is nearer in the distance of logarithms."""
    from scipy.linalg import logm

    start = sk.nematic_start(MESH, TARGET, H)
    rest = sk.RestShape.of(MESH, jnp.asarray(H), "sin")
    exact = sk.bilayer_inverse(MESH, TARGET, H).top.metric[7]
    factor = np.linalg.inv(np.linalg.cholesky(np.asarray(rest.metric[7])))
    log = lambda metric: logm(factor @ np.asarray(metric) @ factor.T).real

    def distance(angle, stretch):
        sheet = sk.Nematic(start.top.angle.at[7].set(angle), start.top.stretch.at[7].set(stretch))
        return np.linalg.norm(log(sheet.actuated_metric(rest.metric)[7]) - log(exact))

    angle, stretch = float(start.top.angle[7]), float(start.top.stretch[7])
    best = distance(angle, stretch)
    for da, ds in ((0.01, 0), (-0.01, 0), (0, 0.002), (0, -0.002), (0.5, 0.0), (0.2, 0.01)):
        assert distance(angle + da, stretch + ds) > best


@pytest.mark.slow
def test_nematic_start_is_nearer_than_none():
    """An ellipsoid as the tutorial's: the start is nearer to it than the sphere is."""
    target = MESH.vertices * jnp.array([0.95, 0.95, 1.1])
    start = problem(sk.nematic_start(MESH, target, H, stretch=1.1))()
    distance = lambda x: float(jnp.sqrt(jnp.mean(jnp.sum((sk.Kabsch()(x, target) - target) ** 2, axis=1))))
    assert bool(start.converged) and distance(start.vertices) < distance(MESH.vertices)


def test_targets_must_fit():
    with pytest.raises(ValueError, match="42 vertices"):
        sk.feasibility(MESH, MESH.vertices[:5], H)


def test_prescribed_metric_is_checked():
    with pytest.raises(ValueError, match="PrescribedMetric: the metric of face 0 is not positive"):
        sk.PrescribedMetric(-jnp.ones((80, 1, 1)) * jnp.eye(2)).check(MESH)
    with pytest.raises(ValueError, match="PrescribedMetric: metric has shape"):
        sk.PrescribedMetric(jnp.ones((3, 2, 2))).check(MESH)
