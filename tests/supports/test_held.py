"""Which unknowns supports hold, where, and what they refuse."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from shellkit import meshes
from shellkit._supports import Clamped, Pinned, Sliding, Symmetry


SHEET = meshes.rectangle(length=2.0, width=1.0, cells=(4, 2))
X = SHEET.vertices
LEFT, RIGHT, FRONT = X[:, 0] < 0.1, X[:, 0] > 1.9, X[:, 1] < 0.1


def held(support, mesh=SHEET):
    return support.held(mesh, 0).reshape(-1, 3)


@pytest.mark.parametrize(
    "selection",
    [LEFT, np.flatnonzero(LEFT), lambda x: x[:, 0] < 0.1, SHEET.edges[LEFT[SHEET.edges].all(axis=1)]],
    ids=["mask", "indices", "predicate", "edges"],
)
@pytest.mark.parametrize("kind", [Pinned, Clamped])
def test_every_way_of_selecting_selects_the_same(kind, selection):
    assert (held(kind(selection)).all(axis=1) == np.asarray(LEFT)).all()
    assert (held(kind(selection)).any(axis=1) == np.asarray(LEFT)).all()


def test_planes_and_lines_along_the_axes_hold_single_coordinates():
    for axis, name in enumerate("xyz"):
        in_plane = held(Sliding(LEFT, normal=name))[np.asarray(LEFT)]
        assert (in_plane == (np.arange(3) == axis)).all()
        on_line = held(Sliding(LEFT, along=-2.0 * np.eye(3)[axis]))[np.asarray(LEFT)]
        assert (on_line == (np.arange(3) != axis)).all()
    assert Sliding(LEFT, along="x").frames(SHEET) is None


def test_a_clamp_holds_the_directors_of_its_edges_and_a_pin_none():
    directors = Clamped(LEFT).held(SHEET, SHEET.n_edges)[3 * SHEET.n_vertices :]
    assert (directors == np.asarray(LEFT[SHEET.edges].all(axis=1))).all()
    assert not Pinned(LEFT).held(SHEET, SHEET.n_edges)[3 * SHEET.n_vertices :].any()
    assert Pinned(LEFT).continuation(SHEET) is None


def test_a_clamp_given_edges_holds_the_normal_of_these_only():
    rim = SHEET.edges[SHEET.boundary_edges]
    corner = SHEET.edges[jnp.flatnonzero(LEFT[SHEET.edges].all(axis=1) & SHEET.boundary_edges)][:1]
    assert len(Clamped(corner).held_edges(SHEET)) == 1
    on_rim, on_vertices = Clamped(rim).held_edges(SHEET), Clamped(SHEET.boundary_vertices).held_edges(SHEET)
    assert len(on_rim) == len(rim) and len(on_vertices) == len(rim) + 2  # two diagonals cut corners


def test_positions_are_those_at_rest_moved_by_what_is_prescribed():
    moved = Pinned(LEFT, displacement=[0.0, 0.0, 0.5]) + Sliding(RIGHT, normal="x", displacement=[0.25, 7.0, 7.0])
    expected = np.array(X)
    expected[np.asarray(LEFT), 2] = 0.5
    expected[np.asarray(RIGHT), 0] += 0.25
    np.testing.assert_allclose(moved.held_positions(SHEET), expected, atol=1e-15)
    half = np.asarray(moved.at(0.5).held_positions(SHEET))
    np.testing.assert_allclose(half, 0.5 * (expected + np.asarray(X)), atol=1e-15)
    np.testing.assert_allclose(moved.at(0.0).held_positions(SHEET), X, atol=1e-15)
    target = np.random.default_rng(0).normal(size=(int(LEFT.sum()), 3))
    np.testing.assert_allclose(Pinned(LEFT, positions=target).held_positions(SHEET)[LEFT], target)
    indices = np.flatnonzero(LEFT)[::-1]
    np.testing.assert_allclose(Pinned(indices, positions=target).held_positions(SHEET)[indices], target)


@pytest.mark.parametrize("angle", [0.0, 1e-7, 1e-3, 1.0, np.pi, 5.0])
def test_a_clamp_turns_as_a_rigid_body(angle):
    axis = np.array([1.0, -2.0, 2.0]) / 3
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.asarray(jax.scipy.linalg.expm(jnp.asarray(angle * k)))
    clamp = Clamped(LEFT, rotation=angle * axis, centre=[1.0, 2.0, 3.0], displacement=[0.0, 1.0, 0.0])
    expected = (np.asarray(X[LEFT]) - [1.0, 2.0, 3.0]) @ turn.T + [1.0, 3.0, 3.0]
    np.testing.assert_allclose(clamp.held_positions(SHEET)[LEFT], expected, atol=1e-13)
    np.testing.assert_allclose(clamp.arms(SHEET), Clamped(LEFT).arms(SHEET) @ turn.T, atol=1e-13)


def test_arms_point_out_of_the_sheet():
    np.testing.assert_allclose(Clamped(LEFT & SHEET.boundary_vertices).arms(SHEET), [[-1.0, 0.0, 0.0]] * 2, atol=1e-15)
    np.testing.assert_allclose(Symmetry(RIGHT, normal=[-3.0, 0.0, 0.0]).arms(SHEET), [[1.0, 0.0, 0.0]] * 2, atol=1e-15)


def test_overlapping_planes_leave_their_line():
    oblique = np.array([1.0, 1.0, 0.0])
    both = Sliding(LEFT, normal="x") + Sliding(LEFT, normal=oblique)
    both.check(SHEET)
    # Together they hold x and y, which are axes: no frame is needed.
    assert both.frames(SHEET) is None
    assert (held(both)[np.asarray(LEFT)] == [True, True, False]).all()


def test_frames_have_their_held_axes_along_the_held_directions():
    normal, tilted = np.array([1.0, 2.0, 2.0]) / 3, Sliding(LEFT, normal=[1.0, 2.0, 2.0], displacement=[0.3, 0.0, 0.0])
    frames = tilted.frames(SHEET)
    assert frames is not None
    vertices, axes = frames
    assert (vertices == np.flatnonzero(LEFT)).all()
    np.testing.assert_allclose(axes @ np.swapaxes(axes, 1, 2), np.tile(np.eye(3), (len(axes), 1, 1)), atol=1e-14)
    flags = held(tilted)[vertices]
    assert (flags.sum(axis=1) == 1).all()
    np.testing.assert_allclose(np.abs(axes[flags] @ normal), 1.0, atol=1e-14)
    np.testing.assert_allclose((tilted.held_positions(SHEET) - X)[LEFT] @ normal, 0.1, atol=1e-14)
    line = Sliding(LEFT, along=[1.0, 2.0, 2.0])
    frames = line.frames(SHEET)
    assert frames is not None
    axes = frames[1]
    free = axes[~held(line)[vertices]]
    np.testing.assert_allclose(np.abs(free @ normal), 1.0, atol=1e-14)


def test_supports_may_overlap_where_they_agree_and_name_the_vertex_where_not():
    (Clamped(LEFT) + Symmetry(FRONT, normal="y") + Pinned(LEFT)).check(SHEET)
    corner = int(jnp.flatnonzero(LEFT & FRONT)[0])
    with pytest.raises(ValueError, match=f"Sliding: vertex {corner} is held already, 0.1 away"):
        (Clamped(LEFT) + Sliding(FRONT, normal="y", displacement=[0.0, 0.1, 0.0])).check(SHEET)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Pinned(jnp.ones(3, bool)), r"mask of vertices has shape \(3,\); expected .*\(15,\)"),
        (lambda: Pinned(jnp.zeros(15, bool)), "no vertex is selected"),
        (lambda: Clamped([3, 15]), "no vertex 15"),
        (lambda: Pinned([3, 3]), "vertex 3 is selected twice"),
        (lambda: Pinned(jnp.ones(15)), "indices of shape"),
        (lambda: Clamped(jnp.array([[0, 7]])), r"no edge between the vertices \[0, 7\]"),
        (lambda: Pinned([3], positions=jnp.zeros(3)), r"positions has shape \(3,\); expected \(1, 3\)"),
        (lambda: Pinned([3], displacement=[0.0, jnp.nan, 0.0]), "displacement is not finite"),
        (lambda: Pinned([3], positions=jnp.zeros((1, 3)), displacement=jnp.zeros(3)), "not both"),
        (lambda: Clamped([3], rotation=1.0), r"rotation has shape \(\); expected \(3,\)"),
        (lambda: Sliding([3]), "one of the two"),
        (lambda: Sliding([3], normal="up"), "'x', 'y', 'z' or a vector"),
        (lambda: Sliding([3], along=[0.0, 0.0, 0.0]), "not zero"),
        (lambda: Symmetry([0, 1], normal="x"), "vertex 0 lies 0.25 off the plane"),
        (lambda: Symmetry([2, 7, 12], normal="x"), "both sides"),
        (lambda: Symmetry(LEFT, normal="z"), "face 0 lies in the plane"),
    ],
)
def test_refusals(make, message):
    with pytest.raises(ValueError, match=message):
        make().check(SHEET)


def test_supports_pass_through_jit_and_have_derivatives():
    supports = (Clamped(LEFT, rotation=jnp.array([0.0, 0.1, 0.0])) + Pinned(RIGHT, displacement=jnp.zeros(3))).on(SHEET)

    @eqx.filter_jit
    def height(supports):
        return jnp.sum(supports.held_positions(SHEET)[:, 2]) + jnp.sum(supports.continuation(SHEET).arms)

    gradient = eqx.filter_grad(height)(supports)
    np.testing.assert_allclose(gradient.terms[1].displacement, [0.0, 0.0, 3.0], atol=1e-14)
    step = 1e-6
    turned = lambda a: eqx.tree_at(lambda s: s.terms[0].rotation, supports, jnp.array([0.0, a, 0.0]))
    slope = (height(turned(0.1 + step)) - height(turned(0.1 - step))) / (2 * step)
    np.testing.assert_allclose(gradient.terms[0].rotation[1], slope, rtol=1e-8)
