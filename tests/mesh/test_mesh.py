"""A mesh as a value: precision, JAX's transformations, and the meshes made from one."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from shellkit import meshes
from shellkit._mesh import Mesh


MESH = meshes.icosphere(1)


def area(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return 0.5 * jnp.linalg.norm(jnp.cross(b - a, c - a), axis=1).sum()


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64, ">f8", jnp.float32])
def test_vertices_of_any_precision_become_float64(dtype):
    mesh = Mesh(np.asarray(MESH.vertices).astype(dtype), np.asarray(MESH.faces).astype(np.uint8))
    assert mesh.vertices.dtype == jnp.float64
    assert mesh.faces.dtype == mesh.twins.dtype == mesh.edges.dtype == jnp.int32


def test_lists_of_numbers_make_a_mesh():
    assert area(Mesh([[0, 0, 0], [2, 0, 0], [0, 1, 0]], [[0, 1, 2]])) == 1.0


def test_single_precision_is_refused():
    with jax.enable_x64(False), pytest.raises(RuntimeError, match="jax_enable_x64"):
        Mesh(np.asarray(MESH.vertices), np.asarray(MESH.faces))


def test_all_arrays_are_leaves():
    leaves, structure = jax.tree.flatten(MESH)
    assert len(leaves) == 8 and all(isinstance(leaf, jax.Array) for leaf in leaves)
    assert jax.tree.unflatten(structure, leaves).n_faces == 80


def test_a_mesh_passes_through_transformations():
    scales = jnp.array([1.0, 2.0, 3.0])
    scaled = lambda s: area(MESH.with_vertices(s * MESH.vertices))
    assert jnp.allclose(jax.vmap(scaled)(scales), scales**2 * area(MESH), rtol=1e-14)
    assert jnp.allclose(jax.grad(scaled)(2.0), 4 * area(MESH), rtol=1e-14)
    batch = eqx.filter_vmap(lambda s: MESH.with_vertices(s * MESH.vertices))(scales)
    assert batch.vertices.shape == (3, 42, 3)
    assert jnp.array_equal(eqx.filter_vmap(area)(batch), jax.vmap(scaled)(scales))

    @jax.jit
    def through(mesh):
        assert mesh.is_closed and mesh.n_edges == 120  # from shapes, known while tracing
        return mesh, mesh.boundary_vertices.any() | mesh.boundary_edges.any()

    same, boundary = through(MESH)
    assert not boundary and eqx.tree_equal(same, MESH)


def test_a_mesh_can_be_built_of_traced_vertices_but_not_of_traced_faces():
    faces = np.asarray(MESH.faces)
    built = jax.jit(lambda v: area(Mesh(v, faces)))(MESH.vertices)
    assert jnp.allclose(built, area(MESH), rtol=1e-15)
    with pytest.raises(ValueError, match="outside jit"):
        jax.jit(lambda f: Mesh(MESH.vertices, f))(MESH.faces)


def test_moving_vertices_keeps_everything_else():
    mesh = Mesh(MESH.vertices, MESH.faces, {"heat": np.arange(42)}, {"angle": np.arange(80.0)})
    moved = mesh.with_vertices(2 * np.asarray(mesh.vertices, np.float32))
    assert moved.vertices.dtype == jnp.float64 and moved.twins is mesh.twins
    assert jnp.array_equal(moved.vertex_data["heat"], mesh.vertex_data["heat"])
    surgery = eqx.tree_at(lambda m: m.vertices, mesh, 2 * mesh.vertices)
    assert jnp.allclose(area(surgery), area(moved), rtol=1e-6)
    with pytest.raises(ValueError, match=r"\(12, 3\).*42"):
        mesh.with_vertices(np.zeros((12, 3)))
    with pytest.raises(ValueError, match="vertex 0"):
        mesh.with_vertices(np.full((42, 3), np.nan))


def first_edges(mesh):
    return mesh.vertices[mesh.faces[:, 1]] - mesh.vertices[mesh.faces[:, 0]]


def normals(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return jnp.cross(b - a, c - a)


def test_flipping_turns_normals_and_keeps_first_edges():
    flipped = MESH.flipped()
    assert jnp.allclose(normals(flipped), -normals(MESH), atol=1e-15)
    assert jnp.array_equal(first_edges(flipped), -first_edges(MESH))
    assert MESH.quality().is_outward and not flipped.quality().is_outward


@pytest.mark.parametrize("mesh", [MESH, meshes.annulus(0.5, 1.0, 0.3)], ids=["closed", "open"])
def test_refining_quarters_each_face_where_it_is(mesh):
    mask = mesh.vertices[:, 2] >= 0
    label = jnp.arange(mesh.n_faces) % 7
    coarse = Mesh(mesh.vertices, mesh.faces, {"x": mesh.vertices, "mask": mask}, {"label": label})
    fine = coarse.refine()
    assert fine.n_faces == 4 * mesh.n_faces and fine.n_vertices == mesh.n_vertices + mesh.n_edges
    parent = np.repeat(np.arange(mesh.n_faces), 4)
    assert jnp.allclose(4 * normals(fine), normals(mesh)[parent], atol=1e-15)
    edges = first_edges(fine) * jnp.tile(jnp.array([1.0, 1.0, 1.0, -1.0]), mesh.n_faces)[:, None]
    assert jnp.allclose(2 * edges, first_edges(mesh)[parent], atol=1e-15)
    middles = fine.vertices[fine.faces].mean(1).reshape(-1, 4, 3)
    assert jnp.allclose(middles.mean(1), mesh.vertices[mesh.faces].mean(1), atol=1e-15)
    assert jnp.array_equal(fine.vertex_data["x"], fine.vertices)
    assert jnp.array_equal(fine.face_data["label"], label[parent])
    new = fine.vertex_data["mask"][mesh.n_vertices :]
    assert jnp.array_equal(new, mask[mesh.edges].all(1))
    assert fine.quality().euler_characteristic == mesh.quality().euler_characteristic


def test_refining_onto_another_surface_moves_the_midpoints_only():
    coarse = meshes.icosphere(1)
    fine = coarse.refine(project=lambda p: p / jnp.linalg.norm(p, axis=1, keepdims=True))
    assert jnp.array_equal(fine.vertices[: coarse.n_vertices], coarse.vertices)
    assert jnp.allclose(jnp.linalg.norm(fine.vertices, axis=1), 1, atol=1e-15)
    assert jnp.array_equal(coarse.prolong(coarse.vertices), coarse.refine().vertices)
    with pytest.raises(ValueError, match=r"shape \(5, 3\); expected \(42, ...\)"):
        coarse.prolong(np.zeros((5, 3)))


def test_boundary_loops_keep_the_surface_to_their_left():
    mesh = meshes.annulus(0.5, 1.0, 0.2)
    loops = mesh.boundary_loops()
    assert sorted(np.concatenate(loops).tolist()) == np.flatnonzero(np.asarray(mesh.boundary_vertices)).tolist()
    turning = {}
    for loop in loops:
        x, y, _ = np.asarray(mesh.vertices)[loop].T
        turning[round(np.hypot(x, y).mean(), 12)] = 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()
    assert set(turning) == {0.5, 1.0}
    assert turning[1.0] > 0 > turning[0.5]
    assert MESH.boundary_loops() == []
