"""How losses add, scale, name themselves and refuse what does not fit."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk


PASSIVE = sk.Passive()


class Height(sk.Loss):
    """A user's own: only `__call__`, and no sum of squares."""

    def __call__(self, equilibrium, actuation):
        return jnp.max(equilibrium.vertices[:, 2])


class Spread(sk.LeastSquaresLoss):
    """A user's own sum of squares: only `residuals`."""

    def residuals(self, equilibrium, actuation):
        return equilibrium.vertices[:, 2]


@pytest.fixture
def here(sphere, at):
    return at(sphere, 1.1 * sphere.vertices)


def test_terms_are_reported_unweighted_by_name(here):
    loss = 2.0 * sk.Area(1.0) + sk.Volume(1.0) + 0.5 * (Height() + 3.0 * sk.Area(2.0)) + sk.Area(3.0)
    total, terms = loss.evaluate(here, PASSIVE)
    assert list(terms) == ["Area", "Volume", "Height", "Area 2", "Area 3"]
    single = [term(here, PASSIVE) for term in (sk.Area(1.0), sk.Volume(1.0), Height(), sk.Area(2.0), sk.Area(3.0))]
    assert np.array_equal(list(terms.values()), single)
    assert np.isclose(total, np.dot([2, 1, 0.5, 1.5, 1], single), rtol=1e-14)
    assert np.isclose(loss(here, PASSIVE), total, rtol=1e-14)


def test_sums_are_flat_and_weights_stay_with_their_terms(here):
    a, b, c = sk.Area(1.0), sk.Volume(1.0), Height()
    assert [type(t) for t in ((a + b) + (c + a)).terms] == [sk.Area, sk.Volume, Height, sk.Area]
    assert eqx.tree_equal(sum([a, b, c]), a + b + c)
    assert eqx.tree_equal(a * 2.0, 2.0 * a) and eqx.tree_equal(2.0 * a, np.float64(2) * a)
    assert eqx.tree_equal(2.0 * a, jnp.asarray(2.0) * a) and eqx.tree_equal(2 * a, 2.0 * a)
    assert np.isclose((2.0 * (3.0 * (a + b)))(here, PASSIVE), 6 * (a + b)(here, PASSIVE), rtol=1e-14)
    for wrong in (lambda: a + 1.0, lambda: 1 + a, lambda: a * b):
        with pytest.raises(TypeError):
            wrong()


def test_residuals_of_sums_and_weights(here):
    squares = 2.0 * sk.Area(1.0) + 0.5 * Spread()
    assert np.isclose(jnp.sum(squares.residuals(here, PASSIVE) ** 2), squares(here, PASSIVE), rtol=1e-14)
    assert Height().residuals(here, PASSIVE) is None
    assert (2.0 * Height()).residuals(here, PASSIVE) is None
    assert (sk.Area(1.0) + Height()).residuals(here, PASSIVE) is None


def test_sums_see_what_any_term_sees():
    invariant, smooth = sk.Area(1.0), sk.DirectorSmoothness()
    assert (Height().sees_motion, Height().needs_shape) == (True, True)
    assert (invariant.sees_motion, (invariant + Height()).sees_motion, (2.0 * invariant).sees_motion) == (0, 1, 0)
    assert ((2.0 * smooth).needs_shape, (smooth + smooth).needs_shape, (smooth + invariant).needs_shape) == (0, 0, 1)


def test_a_weight_is_an_array(here):
    loss = 0.5 * sk.Area(1.0)
    slope = eqx.filter_grad(lambda loss: loss(here, PASSIVE))(loss)
    assert np.isclose(slope.weight, sk.Area(1.0)(here, PASSIVE), rtol=1e-14)


@pytest.mark.parametrize("weight", [-1.0, np.nan, np.inf, np.ones(2)])
def test_wrong_weights_are_refused(weight):
    with pytest.raises(ValueError, match="Area: its weight"):
        sk.Area(1.0) * weight


BAD = {
    "target of another mesh": (lambda: sk.VertexDistance(jnp.zeros((12, 3))), r"12 vertices .* has 42 "),
    "weights of another mesh": (
        lambda: sk.VertexDistance(jnp.zeros((42, 3)), weights=np.ones(80)),
        "weights is for 80",
    ),
    "aligner of another mesh": (lambda: sk.VertexDistance(jnp.zeros((42, 3)), sk.Kabsch(np.ones(7))), r"\(7,\) for 42"),
    "landmark of the aligner": (lambda: sk.VertexDistance(jnp.zeros((42, 3)), sk.Landmarks([0, 1, 42])), "index 42"),
    "flat target": (lambda: sk.VertexDistance(jnp.zeros((42, 2))), r"target has shape \(42, 2\)"),
    "infinite target": (lambda: sk.VertexDistance(np.full((42, 3), np.inf)), "not finite in row 0"),
    "negative weights": (lambda: sk.VertexDistance(np.zeros((42, 3)), weights=-np.ones(42)), r"weights\[0\] is -1"),
    "landmark": (lambda: sk.LandmarkDistance([0, 42], np.zeros((2, 3))), "index 42 is not a vertex; .* 42 "),
    "landmarks and positions": (lambda: sk.LandmarkDistance([0, 1, 2], np.zeros((2, 3))), r"shape \(3,\) .* \(2,\)"),
    "area": (lambda: sk.Area(0.0), "Area: target is 0.0"),
    "two volumes": (lambda: sk.Volume(np.ones(2)), r"target has shape \(2,\)"),
    "mean curvature": (lambda: sk.MeanCurvature(np.zeros(80)), r"\(80,\).* 42 vertices"),
    "no number": (lambda: sk.GaussCurvature(np.nan), "not finite"),
    "bounds": (lambda: sk.StrainLimit(lower=1.1, upper=0.9), "lower is 1.1, upper 0.9"),
    "no directors": (sk.DirectorSmoothness, "Passive has no directors"),
    "in a sum": (lambda: sk.Sphericity() + 0.1 * sk.VertexDistance(jnp.zeros((12, 3))), "12 .* 42"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_does_not_fit_is_refused(case, sphere):
    build, words = BAD[case]
    with pytest.raises(ValueError, match=words):
        build().check(sphere, PASSIVE)


def test_open_and_single_faces_are_refused(sheet, bilayer):
    with pytest.raises(ValueError, match="Volume: the mesh has a boundary"):
        sk.Volume(1.0).check(sheet, PASSIVE)
    single = sk.Mesh(np.eye(3), [[0, 1, 2]])
    with pytest.raises(ValueError, match="nothing to smooth"):
        sk.DirectorSmoothness().check(single, bilayer(single))
    with pytest.raises(ValueError, match="all vertices lie on the boundary"):
        sk.MeanCurvature(0.0).check(single, PASSIVE)


def test_losses_survive_being_traced(sphere):
    """Nothing is checked on values that are not known yet."""

    @jax.jit
    def build(target, weights):
        loss = weights[0] * sk.VertexDistance(target, sk.Kabsch(weights), weights) + sk.Area(weights[1])
        loss.check(sphere, PASSIVE)
        return loss

    assert build(sphere.vertices, jnp.ones(42)).terms[0].term.target.shape == (42, 3)
