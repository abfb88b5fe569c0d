"""What holds for every loss: a catalogue of losses, and properties that each of them must have."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk


def shaken(vertices, seed, size=0.03):
    return vertices + size * np.random.default_rng(seed).normal(size=vertices.shape)


def other(mesh):
    """A surface of another connectivity."""
    coarse = sk.meshes.icosphere(subdivisions=0)
    return coarse.with_vertices(shaken(coarse.vertices, 7) * jnp.array([0.9, 1.0, 1.2]))


# Each built for a mesh, with a target that a shape at random does not meet.
CATALOGUE = {
    "VertexDistance": lambda mesh: sk.VertexDistance(shaken(mesh.vertices, 5) * jnp.array([0.9, 1.0, 1.2])),
    "VertexDistance, weighted": lambda mesh: sk.VertexDistance(
        shaken(mesh.vertices, 5), sk.Similarity(), weights=np.arange(float(mesh.n_vertices))
    ),
    "VertexDistance, landmarks": lambda mesh: sk.VertexDistance(shaken(mesh.vertices, 5), sk.Landmarks([0, 3, 4, 6])),
    "VertexDistance, not aligned": lambda mesh: sk.VertexDistance(shaken(mesh.vertices, 5), sk.NoAlignment()),
    "LandmarkDistance": lambda mesh: sk.LandmarkDistance([7, 2, 3, 0], shaken(mesh.vertices, 6)[:4]),
    "LandmarkDistance, not aligned": lambda mesh: sk.LandmarkDistance(
        [7], shaken(mesh.vertices, 6)[:1], sk.NoAlignment()
    ),
    "PointToSurface": lambda mesh: sk.PointToSurface(other(mesh), normals=0.3, aligner=sk.NoAlignment()),
    "PointToSurface, one way": lambda mesh: sk.PointToSurface(other(mesh), both_ways=False, aligner=sk.NoAlignment()),
    "Chamfer": lambda mesh: sk.Chamfer(other(mesh).vertices, aligner=sk.NoAlignment()),
    "Varifold": lambda mesh: sk.Varifold(other(mesh), aligner=sk.NoAlignment()),
    "Sphericity": lambda mesh: sk.Sphericity(),
    "Area": lambda mesh: sk.Area(5.0),
    "Volume": lambda mesh: sk.Volume(3.0),
    "MeanCurvature": lambda mesh: sk.MeanCurvature(0.7),
    "MeanCurvature, a vertex": lambda mesh: sk.MeanCurvature(np.linspace(-1, 1, mesh.n_vertices)),
    "GaussCurvature": lambda mesh: sk.GaussCurvature(np.linspace(0, 1, mesh.n_vertices)),
    "StrainLimit": lambda mesh: sk.StrainLimit(lower=0.99, upper=1.01),
    "DirectorSmoothness": lambda mesh: sk.DirectorSmoothness(),
    "FoldPenalty": lambda mesh: sk.FoldPenalty(),
    "weighted": lambda mesh: 0.3 * sk.Sphericity(),
    "sum": lambda mesh: sk.VertexDistance(shaken(mesh.vertices, 5)) + 0.01 * sk.FoldPenalty() + sk.DirectorSmoothness(),
}
# Every loss on a closed mesh, and those that know of the boundary on an open one.
SCENES = [(name, "sphere") for name in CATALOGUE]
SCENES += [(name, "sheet") for name in ("MeanCurvature", "GaussCurvature", "DirectorSmoothness", "FoldPenalty")]


@pytest.fixture
def scene(request, at, bilayer):
    """A loss, an equilibrium of a shape at random, and the actuation."""
    name, mesh_name = request.param
    mesh = request.getfixturevalue(mesh_name)
    return CATALOGUE[name](mesh), at(mesh, shaken(mesh.vertices, 1)), bilayer(mesh)


scenes = pytest.mark.parametrize("scene", SCENES, ids=lambda scene: f"{scene[0]} on a {scene[1]}", indirect=True)
TRACES = []


@eqx.filter_jit
def evaluated(loss, equilibrium, actuation):
    """All that a loss says, compiled once per scene."""
    TRACES.append(loss.name)
    parts = (equilibrium, actuation)
    return loss(*parts), loss.residuals(*parts), loss.evaluate(*parts)


def with_vertices(equilibrium, vertices):
    return eqx.tree_at(lambda e: e.vertices, equilibrium, vertices)


@pytest.mark.parametrize("mesh_name", ["sphere", "sheet"])
def test_derivatives_against_differences(mesh_name, request, at, bilayer):
    """In the vertices and angles together, forwards and backwards, first and second; compiled all at once."""
    mesh = request.getfixturevalue(mesh_name)
    names = [name for name, where in SCENES if where == mesh_name and name not in ("weighted", "sum")]
    losses = [CATALOGUE[name](mesh) for name in names]
    actuation, step = bilayer(mesh), 2e-6
    x = (shaken(mesh.vertices, 1), actuation.top.angle, actuation.bottom.angle)
    random = np.random.default_rng(2)
    direction = jax.tree.map(lambda leaf: jnp.asarray(random.normal(size=leaf.shape)), x)

    def values(x):
        moved = eqx.tree_at(lambda a: (a.top.angle, a.bottom.angle), actuation, x[1:])
        return jnp.stack([loss(at(mesh, x[0]), moved) for loss in losses])

    def backwards(x):
        slopes = jax.tree.map(lambda g, d: jnp.sum(g * d, axis=range(1, g.ndim)), jax.jacrev(values)(x), direction)
        return sum(slopes)

    @jax.jit
    def derivatives(x):
        first, second = jax.jvp(backwards, (x,), (direction,))
        return jnp.stack([values(x), jax.jvp(values, (x,), (direction,))[1], first, second])

    def wrong(found, expected, tolerance):
        off = np.abs(found - expected) / np.maximum(1, np.abs(expected))
        return {name: error for name, error in zip(names, off, strict=True) if not error < tolerance}

    here, up, down = (
        derivatives(jax.tree.map(lambda leaf, d, s=s: leaf + s * step * d, x, direction)) for s in (0, 1, -1)
    )
    assert not wrong(here[1], here[2], 1e-11)
    assert not wrong(here[1], (up[0] - down[0]) / (2 * step), 1e-7)
    assert not wrong(here[3], (up[1] - down[1]) / (2 * step), 1e-6)


@scenes
def test_residuals_square_to_the_loss(scene):
    value, residuals, _ = evaluated(*scene)
    assert value > 1e-6
    if residuals is None:
        assert not isinstance(scene[0], sk.LeastSquaresLoss)
        return
    assert residuals.ndim == 1 and np.isclose(np.sum(residuals**2), value, rtol=1e-12)


@scenes
def test_other_numbers_compile_nothing_anew(scene):
    loss, equilibrium, actuation = scene
    evaluated(*scene)
    before = len(TRACES)
    inexact, rest = eqx.partition(loss, eqx.is_inexact_array)
    other = eqx.combine(jax.tree.map(lambda leaf: 1.01 * leaf, inexact), rest)
    evaluated(other, with_vertices(equilibrium, 1.01 * equilibrium.vertices), actuation)
    assert len(TRACES) == before


@scenes
def test_a_rigid_motion_counts_only_where_it_is_seen(scene):
    loss, equilibrium, actuation = scene
    turn = np.linalg.qr(np.random.default_rng(8).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    moved = with_vertices(equilibrium, equilibrium.vertices @ turn + jnp.array([0.5, -1.0, 2.0]))
    same = np.isclose(evaluated(loss, moved, actuation)[0], evaluated(*scene)[0], rtol=1e-10, atol=1e-13)
    assert same == (not loss.sees_motion)


@scenes
def test_a_failed_shape_counts_only_where_a_shape_is_needed(scene):
    """No guard against division by zero may hide what is not a number."""
    loss, equilibrium, actuation = scene
    nowhere = with_vertices(equilibrium, equilibrium.vertices.at[7].set(jnp.nan))
    assert np.isnan(evaluated(loss, nowhere, actuation)[0]) == loss.needs_shape


@scenes
def test_fits_its_mesh_and_reports_its_terms(scene):
    loss, equilibrium, actuation = scene
    loss.check(equilibrium.mesh, actuation)
    value, _, (total, terms) = evaluated(*scene)
    assert np.isclose(total, value, rtol=1e-14)
    if isinstance(loss, sk.SumOfLosses):
        assert set(terms) == {"VertexDistance", "FoldPenalty", "DirectorSmoothness"}
    elif isinstance(loss, sk.WeightedLoss):
        assert np.isclose(loss.weight * terms["Sphericity"], value, rtol=1e-14)
    else:
        assert terms == {type(loss).__name__: value}


@pytest.mark.parametrize("scene", [("sum", "sphere"), ("MeanCurvature", "sheet")], indirect=True)
def test_many_shapes_at_once(scene):
    loss, equilibrium, actuation = scene
    many = jnp.stack([equilibrium.vertices, 1.1 * equilibrium.vertices])
    found = jax.jit(jax.vmap(lambda v: loss(with_vertices(equilibrium, v), actuation)))(many)
    each = [evaluated(loss, with_vertices(equilibrium, v), actuation)[0] for v in many]
    assert np.allclose(found, each, rtol=1e-12)
