"""Aligners on every kind of point set: what they find, that it is the best, and that its derivatives are right."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk


RANDOM = np.random.default_rng(11)


def rotation(seed):
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.linalg.det(q)


def moved(points):
    return points @ rotation(5) + np.array([0.3, -1.0, 2.0])


GENERIC = RANDOM.normal(size=(12, 3)) * [1.0, 2.0, 3.0]
SPHERE = np.asarray(sk.meshes.icosphere(subdivisions=0).vertices)
PLANAR = GENERIC * [1, 1, 0]
NOISE = 0.1 * RANDOM.normal(size=(12, 3))

# Points and target, with one best rotation: all derivatives are defined.
UNIQUE = {
    "generic": (GENERIC, moved(GENERIC) + NOISE),
    "sphere": (SPHERE, moved(SPHERE)),
    "noisy sphere": (SPHERE, moved(SPHERE) + NOISE),
    "planar": (PLANAR, moved(PLANAR)),
    "planar onto generic": (PLANAR, moved(GENERIC)),
    "mirrored": (GENERIC, moved(GENERIC * [-1, 1, 1])),
    "mirrored planar": (PLANAR, moved(PLANAR * [-1, 1, 1])),
}
# Several best rotations: derivatives must still be finite.
AMBIGUOUS = {
    "collinear": (GENERIC * [0, 0, 1], moved(GENERIC * [0, 0, 1])),
    "mirrored sphere": (SPHERE, -SPHERE),
    "one point": (np.ones((12, 3)), moved(GENERIC)),
    "all in one place": (np.zeros((12, 3)), np.zeros((12, 3))),
}
EVERY = {**UNIQUE, **AMBIGUOUS}
# Not negative, and one vanishes: its point must not count.
WEIGHTS = np.arange(12.0)
ALIGNERS = {
    "Kabsch": sk.Kabsch(),
    "weighted Kabsch": sk.Kabsch(WEIGHTS),
    "Similarity": sk.Similarity(),
    "Landmarks": sk.Landmarks([0, 2, 3, 7, 8]),
    "NoAlignment": sk.NoAlignment(),
}
RIGID = ("Kabsch", "weighted Kabsch", "Landmarks")


@eqx.filter_jit
def aligned(aligner, points, target):
    return aligner(points, target)


def score(aligner, points, target):
    """A number that sees every coordinate of the moved points, of no symmetry."""
    return jnp.sum(jnp.sin(aligner(points, target) + jnp.arange(36.0).reshape(12, 3)))


@pytest.mark.parametrize("points, target", EVERY.values(), ids=EVERY)
def test_rotations_are_proper(points, target):
    for aligner in (sk.Kabsch(), sk.Similarity()):
        motion = eqx.filter_jit(aligner.motion)(jnp.asarray(points), jnp.asarray(target))
        assert np.allclose(motion.rotation @ motion.rotation.T, np.eye(3), atol=1e-13)
        assert np.isclose(np.linalg.det(motion.rotation), 1, atol=1e-13)


@pytest.mark.parametrize("points, target", EVERY.values(), ids=EVERY)
def test_no_other_rotation_is_better(points, target):
    centred, wanted = points - points.mean(0), target - target.mean(0)
    best = np.sum((np.asarray(aligned(sk.Kabsch(), points, target)) - target) ** 2)
    others = np.stack([rotation(seed) for seed in range(300)])
    assert best <= np.sum((centred @ others - wanted) ** 2, axis=(1, 2)).min() + 1e-12


@pytest.mark.parametrize("name", RIGID)
@pytest.mark.parametrize("kind", ["generic", "sphere", "planar", "collinear"])
def test_finds_a_motion_that_is_there(name, kind):
    points = EVERY[kind][0]
    assert np.allclose(aligned(ALIGNERS[name], points, moved(points)), moved(points), atol=1e-13)


def test_similarity_finds_the_scale():
    target = 2.5 * moved(GENERIC)
    motion = sk.Similarity().motion(jnp.asarray(GENERIC), jnp.asarray(target))
    assert np.isclose(motion.scale, 2.5, rtol=1e-13)
    assert np.allclose(aligned(sk.Similarity(), GENERIC, target), target, atol=1e-13)
    noisy = target + NOISE
    best = np.sum((np.asarray(aligned(sk.Similarity(), GENERIC, noisy)) - noisy) ** 2)
    centred, wanted = (GENERIC - GENERIC.mean(0)) @ rotation(5), noisy - noisy.mean(0)
    assert best < min(np.sum((scale * centred - wanted) ** 2) for scale in np.linspace(2.4, 2.6, 21))
    assert np.allclose(aligned(sk.Similarity(), *AMBIGUOUS["one point"]), AMBIGUOUS["one point"][1].mean(0))


@pytest.mark.parametrize("name", ALIGNERS)
def test_motion_beforehand_does_not_count_exactly_if_removed(name):
    points, target = UNIQUE["generic"]
    found, again = aligned(ALIGNERS[name], points, target), aligned(ALIGNERS[name], moved(points), target)
    assert np.allclose(found, again, atol=1e-12) == ALIGNERS[name].removes_motion


def test_far_from_the_origin_no_digits_are_lost():
    found = aligned(sk.Kabsch(), GENERIC + 1e6, moved(GENERIC) + 1e6)
    assert np.allclose(found, moved(GENERIC) + 1e6, atol=1e-8)


@pytest.mark.parametrize("kind", UNIQUE)
@pytest.mark.parametrize("name", ["Kabsch", "weighted Kabsch", "Similarity"])
def test_derivatives_against_differences(name, kind):
    """With respect to both point sets, forwards and backwards, first and second order, equal singular values or not."""
    points, target = (jnp.asarray(x) for x in UNIQUE[kind])
    random = np.random.default_rng(1)
    direction = (jnp.asarray(random.normal(size=(12, 3))), jnp.asarray(random.normal(size=(12, 3))))
    forwards, backwards, second = derivatives(ALIGNERS[name], points, target, direction)
    step = 1e-5
    at = [
        derivatives(ALIGNERS[name], points + s * step * direction[0], target + s * step * direction[1], direction)
        for s in (1, -1)
    ]
    values = [
        score(ALIGNERS[name], points + s * step * direction[0], target + s * step * direction[1]) for s in (1, -1)
    ]
    assert np.isclose(forwards, backwards, rtol=1e-11, atol=1e-12)
    assert np.isclose(forwards, (values[0] - values[1]) / (2 * step), rtol=1e-6, atol=1e-7)
    assert np.isclose(second, (at[0][0] - at[1][0]) / (2 * step), rtol=1e-6, atol=1e-6)


@eqx.filter_jit
def derivatives(aligner, points, target, direction):
    def slope(points, target):
        return jax.jvp(lambda p, t: score(aligner, p, t), (points, target), direction)[1]

    def gradient(points, target):
        return jax.grad(lambda p, t: score(aligner, p, t), argnums=(0, 1))(points, target)

    def against(gradient):
        return sum(jnp.sum(g * d) for g, d in zip(gradient, direction, strict=True))

    second = jax.jvp(gradient, (points, target), direction)[1]
    return slope(points, target), against(gradient(points, target)), against(second)


@pytest.mark.parametrize("kind", EVERY)
def test_derivatives_are_finite(kind):
    points, target = (jnp.asarray(x) for x in EVERY[kind])
    for aligner in (sk.Kabsch(), sk.Similarity()):
        found = derivatives(aligner, points, target, (jnp.asarray(NOISE), jnp.asarray(NOISE[::-1])))
        assert np.isfinite(found).all()


def test_collinear_points_turn_with_their_line():
    """The rotation about the line is not determined; what it does to the line is, and so is the derivative of that."""
    points, target = (jnp.asarray(x) for x in AMBIGUOUS["collinear"])
    along = jnp.asarray(np.outer(GENERIC[:, 2], NOISE[0]))
    change = jax.jvp(lambda t: sk.Kabsch()(points, t), (target,), (along,))[1]
    step = 1e-5
    difference = (sk.Kabsch()(points, target + step * along) - sk.Kabsch()(points, target - step * along)) / (2 * step)
    assert np.allclose(change, difference, atol=1e-7)


def test_gradient_of_the_distance_needs_no_derivative_of_the_rotation():
    """At the minimum over motions, only the direct dependence on the points is left."""
    points, target = (jnp.asarray(x) for x in UNIQUE["generic"])
    for aligner, weights in ((sk.Kabsch(), np.ones(12)), (sk.Kabsch(WEIGHTS), WEIGHTS)):
        motion = aligner.motion(points, target)
        gap = motion(points) - target
        found = jax.jit(jax.grad(lambda p, a=aligner, w=weights: jnp.sum(w[:, None] * (a(p, target) - target) ** 2)))(
            points
        )
        assert np.allclose(found, 2 * weights[:, None] * gap @ motion.rotation.T, atol=1e-12)


def test_weights_count_as_repetitions():
    points, target = (jnp.asarray(x) for x in UNIQUE["generic"])
    repeat = np.repeat(np.arange(12), WEIGHTS.astype(int))
    repeated = sk.Kabsch().motion(points[repeat], target[repeat])
    found = aligned(sk.Kabsch(WEIGHTS), points, target)
    assert np.allclose(found, repeated(points), atol=1e-12)
    assert np.allclose(found, aligned(sk.Kabsch(3 * WEIGHTS), points, target), atol=1e-13)


def test_landmarks_decide_for_all():
    target = moved(GENERIC) + NOISE
    marked = np.array([1, 4, 5, 9])
    target[marked] = moved(GENERIC)[marked]
    assert np.allclose(aligned(sk.Landmarks(marked), GENERIC, target), moved(GENERIC), atol=1e-12)
    fewer = target[marked[::-1]]
    partners = sk.Landmarks(marked, target_indices=[3, 2, 1, 0])
    assert np.allclose(aligned(partners, GENERIC, fewer), moved(GENERIC), atol=1e-12)
    scaled = sk.Landmarks(marked, aligner=sk.Similarity())
    assert np.allclose(aligned(scaled, GENERIC, 2 * target), 2 * moved(GENERIC), atol=1e-12)
    still = sk.Landmarks(marked, aligner=sk.NoAlignment())
    assert not still.removes_motion and np.array_equal(aligned(still, GENERIC, target), GENERIC)


def test_vmap_is_a_loop():
    points, target = (jnp.asarray(x) for x in UNIQUE["noisy sphere"])
    many = jnp.stack([points, 2 * points, points + 1])
    gradients = jax.jit(jax.grad(lambda p: score(sk.Kabsch(), p, target)))
    each = jnp.stack([gradients(p) for p in many])
    assert np.allclose(jax.vmap(gradients)(many), each, atol=1e-12)


def test_absent_parts_cost_nothing():
    def program(aligner):
        return str(jax.make_jaxpr(jax.grad(lambda p: jnp.sum(aligner(p, jnp.asarray(SPHERE)))))(jnp.asarray(GENERIC)))

    assert program(sk.NoAlignment()).count("dot_general") == 0
    assert program(sk.Kabsch()).count("= svd") == 1


POINTS = jnp.zeros((12, 3))


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: sk.Kabsch([1.0, -1.0, 2.0]), r"Kabsch: weights\[1\] is -1.0"),
        (lambda: sk.Similarity([1.0, np.nan]), r"Similarity: weights\[1\] is nan"),
        (lambda: sk.Kabsch(np.zeros(3)), "all 3 weights are zero"),
        (lambda: sk.Kabsch(np.ones((3, 1))), r"shape \(3, 1\)"),
        (lambda: sk.Kabsch(np.ones(5))(POINTS, POINTS), r"weights of shape \(5,\) for 12 points"),
        (lambda: sk.Kabsch()(POINTS, POINTS[:7]), r"12 points .* target of 7"),
        (lambda: sk.Landmarks([0, 1]), "has 2 entries"),
        (lambda: sk.Landmarks([0.0, 1.0, 2.0]), "type float"),
        (lambda: sk.Landmarks([0, 1, 2], [0, 1, 2, 3]), "3 indices but 4 target_indices"),
        (lambda: sk.Landmarks([0, 1, 12])(POINTS, POINTS), "index 12 lies outside the points, which have 12 rows"),
        (lambda: sk.Landmarks([0, 1, 8])(POINTS, POINTS[:8]), "index 8 lies outside the target"),
    ],
)
def test_refusals(build, words):
    with pytest.raises(ValueError, match=words):
        build()
