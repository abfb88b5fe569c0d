"""Normals, areas, frames and volumes against bodies whose answers are known."""

import re

import jax
import jax.numpy as jnp
import numpy as np

import shellkit as sk


def test_cube(cube):
    v = cube.vertices
    assert np.allclose(sk.face_areas(v, cube), 0.5, atol=1e-15)
    assert np.isclose(sk.surface_area(v, cube), 6, atol=1e-14)
    assert np.isclose(sk.enclosed_volume(v, cube), 1, atol=1e-14)
    assert np.isclose(sk.edge_lengths(v, cube).sum(), 12 + 6 * np.sqrt(2), atol=1e-13)
    outward = np.sign(np.asarray(v)[np.asarray(cube.faces)].mean(1) - 0.5) * (
        np.abs(np.asarray(v)[np.asarray(cube.faces)].mean(1) - 0.5) > 0.4
    )
    assert np.allclose(sk.face_normals(v, cube), outward, atol=1e-15)


def test_moves_and_scales(generic):
    v = generic.vertices
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    for scale in (1e-6, 1.0, 1e6):
        moved = scale * (v @ turn + jnp.array([1.0, 2.0, 3.0]))
        assert np.allclose(sk.enclosed_volume(moved, generic), scale**3 * sk.enclosed_volume(v, generic), rtol=1e-12)
        assert np.allclose(sk.face_areas(moved, generic), scale**2 * sk.face_areas(v, generic), rtol=1e-12)
        assert np.allclose(sk.face_normals(moved, generic), sk.face_normals(v, generic) @ turn, atol=1e-12)
    assert np.allclose(sk.enclosed_volume(v + 1e6, generic), sk.enclosed_volume(v, generic), rtol=1e-9)
    mirrored = generic.flipped()
    assert np.isclose(sk.enclosed_volume(v, mirrored), -sk.enclosed_volume(v, generic))


def test_sphere_converges_with_the_square_of_the_edge():
    errors = []
    for subdivisions in (1, 2, 3):
        mesh = sk.meshes.icosphere(subdivisions=subdivisions)
        area, volume = sk.surface_area(mesh.vertices, mesh), sk.enclosed_volume(mesh.vertices, mesh)
        errors.append([4 * np.pi - area, 4 * np.pi / 3 - volume])
    ratios = np.divide(errors[:-1], errors[1:])
    assert (np.array(errors) > 0).all() and (ratios > 3.7).all() and (ratios < 4.3).all()


def test_frames_are_right_handed_from_the_first_edge(generic):
    v, faces = np.asarray(generic.vertices), np.asarray(generic.faces)
    e1, e2 = sk.face_frames(generic.vertices, generic)
    first = v[faces[:, 1]] - v[faces[:, 0]]
    assert np.allclose(e1 * np.linalg.norm(first, axis=1)[:, None], first, atol=1e-15)
    assert np.allclose(np.sum(e1 * e2, 1), 0, atol=1e-15) and np.allclose(np.sum(e2 * e2, 1), 1, atol=1e-15)
    assert np.allclose(np.cross(e1, e2), sk.face_normals(generic.vertices, generic), atol=1e-14)


def test_vertex_areas_share_the_surface(generic, cube):
    for mesh in (generic, cube, sk.meshes.rectangle(2.0, 1.0, cells=(3, 2))):
        areas = sk.vertex_areas(mesh.vertices, mesh)
        assert np.isclose(areas.sum(), sk.surface_area(mesh.vertices, mesh), rtol=1e-14)
    around = np.bincount(np.asarray(cube.faces).ravel())
    assert np.allclose(sk.vertex_areas(cube.vertices, cube), around / 6, atol=1e-15)


SCALARS = {
    "area": sk.surface_area,
    "volume": sk.enclosed_volume,
    "areas": lambda v, m: jnp.sum(sk.face_areas(v, m) ** 2),
    "vertex areas": lambda v, m: jnp.sum(sk.vertex_areas(v, m) ** 2),
    "voronoi areas": lambda v, m: jnp.sum(sk.voronoi_areas(v, m) ** 2),
    "lengths": lambda v, m: jnp.sum(sk.edge_lengths(v, m) ** 3),
    "normals": lambda v, m: jnp.sum(sk.face_normals(v, m) ** 3),
    "frames": lambda v, m: sum(jnp.sum(e**3) for e in sk.face_frames(v, m)),
    "dihedral": lambda v, m: jnp.sum(sk.dihedral_angles(v, m) ** 3),
    "mean curvature": lambda v, m: jnp.sum(sk.mean_curvature(v, m) ** 2),
    "defects": lambda v, m: jnp.sum(sk.angle_defects(v, m) ** 2),
    "gauss curvature": lambda v, m: jnp.sum(sk.gauss_curvature(v, m) ** 2),
}


def scalars(vertices, mesh):
    """A number made of each quantity; all at once, since compiling takes longer than computing."""
    return jnp.stack([scalar(vertices, mesh) for scalar in SCALARS.values()])


def wrong(holds):
    return [name for name, good in zip(SCALARS, holds, strict=True) if not good]


def test_derivatives_forwards_and_backwards(generic):
    """Against central differences, to second order."""
    direction = jnp.asarray(np.random.default_rng(7).normal(size=(42, 3)))

    @jax.jit
    def derivatives(v):
        def value(v):
            return scalars(v, generic)

        def backwards(v):
            return jnp.sum(jax.jacrev(value)(v) * direction, axis=(1, 2))

        first, second = jax.jvp(backwards, (v,), (direction,))
        return value(v), jax.jvp(value, (v,), (direction,))[1], first, second

    step = 1e-5
    _, forwards, backwards, second = derivatives(generic.vertices)
    up, down = (derivatives(generic.vertices + sign * step * direction) for sign in (1, -1))
    assert not wrong(np.isclose(forwards, backwards, rtol=1e-10, atol=1e-12))
    assert not wrong(np.isclose(forwards, (up[0] - down[0]) / (2 * step), rtol=1e-6))
    assert not wrong(np.isclose(second, (up[1] - down[1]) / (2 * step), rtol=1e-6))


def test_faces_without_area_are_finite():
    mesh = sk.meshes.rectangle(2.0, 1.0, cells=(2, 2))
    point = mesh.vertices.at[1].set(mesh.vertices[4])
    line = mesh.vertices.at[:, 1].set(0.0)
    evaluate = jax.jit(lambda v: (scalars(v, mesh), jax.jacrev(scalars)(v, mesh)))
    for vertices in (point, line, jnp.zeros_like(point)):
        values, slopes = evaluate(vertices)
        assert not wrong(np.isfinite(values)) and not wrong(np.isfinite(slopes).all((1, 2)))


def test_program_does_not_grow_with_the_mesh():
    """No loop over elements is unrolled, and nothing is decomposed."""
    sizes = []
    for subdivisions in (0, 1):
        mesh = sk.meshes.icosphere(subdivisions=subdivisions)
        program = str(jax.make_jaxpr(jax.jacrev(scalars))(mesh.vertices, mesh))
        assert not re.search(r"= (svd|eigh|lu|cholesky|while|scan)\b", program)
        sizes.append(program.count(" = "))
    assert sizes[0] == sizes[1]
