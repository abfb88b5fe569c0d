"""Laminates against Timoshenko's bimetal, the bilayer and a numerical integral through the thickness."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk


H = 0.05
MESH = sk.meshes.rectangle(1.0, 0.5, cells=(3, 2), diagonals="jittered")
REST = sk.RestShape.of(MESH, jnp.asarray(H), "theta")
BALL = sk.meshes.icosphere(subdivisions=1)
BENT = sk.RestShape.of(BALL, jnp.asarray(H), "theta")


def grown(strain):
    """A sheet whose Green strain is exactly `strain`."""
    return sk.IsotropicGrowth(jnp.sqrt(1 + 2 * strain))


@pytest.mark.parametrize("thicknesses", [(1.0, 1.0), (1.0, 3.0), (0.7, 0.1)])
@pytest.mark.parametrize("moduli", [(1.0, 1.0), (5.0, 1.0), (0.1, 2.0)])
def test_timoshenko_bimetal(thicknesses, moduli):
    """1/ρ = 6 (ε2 - ε1)(1 + m)² / (h (3 (1 + m)² + (1 + m n)(m² + 1/(m n)))), m = a1/a2, n = E1/E2; layer 2 on top."""
    strains = (0.001, 0.004)
    m, n = thicknesses[0] / thicknesses[1], moduli[0] / moduli[1]
    layers = [sk.Layer(grown(e), t, s) for e, t, s in zip(strains, thicknesses, moduli, strict=True)]
    found = sk.Laminate(layers)(REST)
    expected = (
        6 * (strains[1] - strains[0]) * (1 + m) ** 2 / (H * (3 * (1 + m) ** 2 + (1 + m * n) * (m**2 + 1 / (m * n))))
    )
    assert jnp.allclose(found.curvature, expected * REST.metric, rtol=1e-12, atol=1e-14)


def test_two_equal_layers_are_a_bilayer():
    angles = jnp.asarray(np.random.default_rng(0).uniform(0, np.pi, (2, BALL.n_faces)))
    top, bottom = sk.Nematic(angles[0], 1.1), sk.Nematic(angles[1], 1.2)
    expected = sk.Bilayer(top, bottom)(BENT)
    found = sk.Laminate([sk.Layer(bottom), sk.Layer(top)])(BENT)
    assert jnp.allclose(found.metric, expected.metric, atol=1e-15)
    assert jnp.allclose(found.curvature, expected.curvature, atol=1e-13)
    assert jnp.allclose(found.stretching, 1) and jnp.allclose(found.bending, 1)


def test_layers_may_be_split():
    """One layer cut in two, or three, is the same shell."""
    angles = jnp.asarray(np.random.default_rng(0).uniform(0, np.pi, BALL.n_faces))
    sheet, other = sk.Nematic(angles, 1.1), sk.IsotropicGrowth(0.97)
    whole = sk.Laminate([sk.Layer(sheet, 2.0, 3.0), sk.Layer(other, 1.0, 0.5)])(BENT)
    cut = sk.Laminate([sk.Layer(sheet, 0.5, 3.0), sk.Layer(sheet, 1.5, 3.0), sk.Layer(other, 1.0, 0.5)])(BENT)
    for name in ("metric", "curvature", "stretching"):
        a, b = getattr(whole, name), getattr(cut, name)
        assert jnp.allclose(a, b, rtol=1e-12, atol=1e-13)
    assert jnp.allclose(whole.bending, cut.bending, rtol=1e-12)


def test_energy_is_the_integral_through_the_thickness():
    """The energy of a random shape, less that of another, against Gauss quadrature of the layers themselves."""
    alpha, beta = 0.6, 1.3
    rng = np.random.default_rng(1)
    thick = [jnp.asarray(rng.uniform(0.5, 2.0, BALL.n_faces)) for _ in range(3)]
    stiff = [jnp.asarray(rng.uniform(0.5, 2.0, BALL.n_faces)) for _ in range(3)]
    sheets = [sk.IsotropicGrowth(1.02), sk.Nematic(thick[0], 0.98), sk.Passive()]
    laminate = sk.Laminate([sk.Layer(a, t, s) for a, t, s in zip(sheets, thick, stiff, strict=True)])
    problem = sk.InverseProblem(
        mesh=BALL,
        thickness=H,
        actuation=laminate,
        energy=sk.StVenantKirchhoff(alpha, beta) + sk.Bending(alpha, beta, form="theta"),
    )
    shapes = [BALL.vertices + 0.02 * rng.normal(size=BALL.vertices.shape) for _ in range(2)]
    found = float(problem.total_energy(shapes[0]) - problem.total_energy(shapes[1]))

    heights = np.array(thick) / np.sum(thick, axis=0) * H
    stiff = np.array(stiff)
    middles = np.cumsum(heights, axis=0) - heights / 2
    middles -= (stiff * heights * middles).sum(0) / (stiff * heights).sum(0)
    norm = np.linalg.inv(laminate(BENT).metric)
    areas = 0.5 * np.sqrt(np.linalg.det(laminate(BENT).metric))
    totals = []
    for x in shapes:
        g, b = np.asarray(sk.first_form(x, BALL)), np.asarray(sk.second_form(x, BALL, "theta"))
        total = 0.0
        for i, sheet in enumerate(sheets):
            wanted = np.asarray(sheet.actuated_metric(BENT.metric))
            for node in (-1, 1):
                z = (middles[i] + node * heights[i] / np.sqrt(12))[:, None, None]
                m = norm @ (g + 2 * z * b - wanted - 2 * z * np.asarray(BENT.curvature))
                square = alpha * np.trace(m, axis1=1, axis2=2) ** 2 + 2 * beta * np.einsum("fij,fji->f", m, m)
                total += np.sum(0.25 * areas * stiff[i] * heights[i] / 2 * square)
        totals.append(total)
    assert np.isclose(found, totals[0] - totals[1], rtol=1e-9)


def test_ramp_and_directors():
    angles = jnp.zeros(BALL.n_faces)
    laminate = sk.Laminate([sk.Layer(sk.Nematic(angles, 1.1), 2.0, 3.0), sk.Layer()])
    none, whole = laminate.at(0.0)(BENT), laminate.at(1.0)(BENT)
    assert jnp.allclose(none.metric, BENT.metric) and jnp.allclose(none.curvature, BENT.curvature, atol=1e-13)
    assert jnp.allclose(whole.metric, laminate(BENT).metric, atol=1e-14)
    assert len(laminate.director_fields()) == 1
    assert sk.Laminate([sk.Layer()])(eqx.tree_at(lambda r: r.curvature, BENT, None)).curvature is None


def test_ramp_of_ones_own_actuation():
    """Forms are interpolated; the stiffness of the layers is there from the start."""

    class Plywood(sk.Actuation):
        """A user's own, made of the library's."""

        def __call__(self, rest):
            return sk.Laminate([sk.Layer(sk.IsotropicGrowth(1.1), 2.0, 3.0), sk.Layer()])(rest)

    whole, half = Plywood()(BENT), Plywood().at(0.5)(BENT)
    assert jnp.allclose(half.metric, 0.5 * (BENT.metric + whole.metric))
    assert jnp.allclose(half.stretching, whole.stretching) and jnp.allclose(half.bending, whole.bending)


@pytest.mark.parametrize(
    "layers, words",
    [
        ([], "no layers"),
        ([sk.Layer(), sk.Layer(thickness=0.0)], "layer 1: the thickness"),
        ([sk.Layer(stiffness=jnp.ones(3))], "layer 0: stiffness has shape"),
    ],
)
def test_bad_laminates_are_refused(layers, words):
    with pytest.raises(ValueError, match=words):
        sk.Laminate(layers).check(BALL)
