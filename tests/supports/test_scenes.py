"""Shells on supports against exact answers: mirror images, rigid motions, forces that balance, derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk
from shellkit import Clamped, EdgeLoad, Pinned, Sliding, SurfaceLoad, Symmetry
from shellkit._energy import Unknowns


def dome(cells=(4, 4), diagonals="alternating", length=1.0):
    flat = sk.meshes.rectangle(length=length, width=1.0, cells=cells, diagonals=diagonals)
    x, y, _ = flat.vertices.T
    return flat.with_vertices(jnp.column_stack([x, y, 0.3 - 0.2 * x**2 - 0.3 * (y - 0.4) ** 2]))


def shell(mesh, supports, directors="free", load=None, thickness=0.1):
    energy = sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0, directors=directors)
    return sk.InverseProblem(mesh, thickness, energy if load is None else energy + load, supports=supports)


EDGE = lambda x: x[:, 0] < 0.1


@pytest.mark.parametrize("directors", ["free", "average"])
def test_derivatives_in_the_free_unknowns(directors):
    """A clamped region that has been turned, a plane of symmetry, an oblique plane and an oblique line at once."""
    mesh = dome((4, 3))
    x, y, _ = mesh.vertices.T
    supports = Clamped(x < 0.3, rotation=jnp.array([0.1, 0.2, 0.3])) + Symmetry((x > 0.3) & (y < 0.1), normal="y")
    supports += Sliding((x > 0.9) & (y < 0.9), normal=[1.0, 2.0, 3.0]) + Sliding([19], along=[1.0, 2.0, 3.0])
    problem = shell(mesh, supports, directors, thickness=0.3)
    y = problem.assembly.dofs.gather(Unknowns(problem.supports.held_positions(mesh)))
    y = y + 0.03 * jax.random.normal(jax.random.key(0), y.shape)

    @jax.jit
    def derivatives(y):
        energy = problem.discrete_energy()
        return (
            jax.grad(energy.__call__)(y),
            energy.gradient(y),
            jax.jacfwd(energy.gradient)(y),
            energy.hessian(y).values,
        )

    automatic, gradient, jacobian, values = derivatives(y)
    np.testing.assert_allclose(gradient, automatic, atol=1e-15)
    pattern = problem.assembly.pattern
    np.testing.assert_allclose(values, jacobian[pattern.rows, pattern.indices], atol=1e-13)
    assert np.count_nonzero(np.abs(jacobian) > 1e-13) <= 2 * pattern.nnz - pattern.n


@pytest.mark.slow
@pytest.mark.parametrize(("directors", "oblique"), [("free", True), ("average", False)])
def test_one_half_with_symmetry_bends_as_the_whole(directors, oblique):
    half = dome((4, 4))
    n = half.n_vertices
    on_plane = half.vertices[:, 0] < 1e-9
    # The mirror image shares the vertices on the plane; its faces run the other way round.
    number = jnp.where(on_plane, jnp.arange(n), n + jnp.cumsum(~on_plane) - 1).astype(half.faces.dtype)
    mirrored = (half.vertices * jnp.array([-1.0, 1.0, 1.0]))[~on_plane]
    whole = sk.Mesh(
        jnp.concatenate([half.vertices, mirrored]), jnp.concatenate([half.faces, number[half.faces][:, ::-1]])
    )
    turn = jnp.eye(3)
    if oblique:
        turn = jax.scipy.linalg.expm(jnp.cross(jnp.eye(3), jnp.array([0.3, -0.5, 0.4])))
    load = SurfaceLoad(turn @ jnp.array([0.0, 0.0, -1e-3]))
    half, whole = (m.with_vertices(m.vertices @ turn.T) for m in (half, whole))

    rim = whole.boundary_vertices
    reference = shell(whole, Pinned(rim), directors, load)()
    supports = Symmetry(on_plane, normal=turn[:, 0]) + Pinned(rim[:n])
    equilibrium = shell(half, supports, directors, load)()
    assert equilibrium.converged and reference.converged
    assert float(jnp.max(jnp.abs(equilibrium.vertices - half.vertices))) > 1e-3
    np.testing.assert_allclose(equilibrium.vertices, reference.vertices[:n], atol=1e-10)
    np.testing.assert_allclose(2 * equilibrium.energy, reference.energy, rtol=1e-10)


@pytest.mark.slow
def test_a_clamp_that_moves_as_a_rigid_body_takes_the_shell_along():
    mesh = dome()
    rotation, shift = jnp.array([0.4, -0.3, 0.6]), jnp.array([0.0, 2.0, 0.0])
    clamp = Clamped(EDGE, rotation=rotation, displacement=shift, centre=jnp.zeros(3))
    problem = shell(mesh, clamp)
    relax = eqx.filter_jit(lambda progress, start: problem.at(progress)(start))
    turn = jax.scipy.linalg.expm(jnp.cross(jnp.eye(3), rotation))
    moved = mesh.vertices @ turn.T + shift
    np.testing.assert_allclose(problem.discrete_energy()(problem.assembly.dofs.gather(Unknowns(moved))), 0, atol=1e-25)
    equilibrium = relax(jnp.array(0.0), None)
    np.testing.assert_allclose(equilibrium.vertices, mesh.vertices, atol=1e-12)
    # In steps of two edges: a jump lands in the minimum it lands in.
    for progress in (0.25, 0.5, 0.75, 1.0):
        equilibrium = relax(jnp.array(progress), equilibrium)
    assert equilibrium.converged
    np.testing.assert_allclose(equilibrium.vertices, moved, atol=1e-8)


@pytest.mark.parametrize("directors", ["free", "average"])
def test_moments_are_what_turning_a_clamp_takes(directors):
    """At any shape: the derivative of the energy as the clamp turns is what its forces and couples do together."""
    mesh = dome((3, 3))
    problem = shell(mesh, Clamped(EDGE, rotation=jnp.array([0.1, -0.2, 0.3])), directors, thickness=0.3)
    y = problem.assembly.dofs.gather(Unknowns(mesh.vertices))
    y = y + 0.05 * jax.random.normal(jax.random.key(0), y.shape)

    @jax.jit
    def work(turn):
        """The energy once the clamp is turned on about the origin, to first order."""
        now = jnp.eye(3) + jnp.cross(jnp.eye(3), turn)
        energy = problem.discrete_energy()
        arms = lambda e: e.faces.continuation.arms
        turned = jnp.einsum("ab,ibf->iaf", now, arms(energy))
        vertices = problem.assembly.dofs.unpack(energy.prescribed).vertices
        held = problem.assembly.dofs.pack(Unknowns(vertices @ now.T))
        return eqx.tree_at(lambda e: (e.prescribed, arms(e)), energy, (held, turned))(y)

    energy = problem.discrete_energy()
    pose = problem.posed(energy, y)
    vertices, forces, couples = pose.unknowns.vertices, pose.reactions, pose.moments
    total = jnp.sum(jnp.cross(vertices, forces), axis=0) + jnp.sum(couples, axis=0)
    np.testing.assert_allclose(total, jax.grad(work)(jnp.zeros(3)), rtol=1e-9)
    assert float(jnp.abs(jnp.sum(couples, axis=0)).max()) > 0.01 * float(jnp.abs(total).max())


@pytest.mark.slow
def test_a_clamp_carries_force_and_moment():
    """A narrow strip under an end force P, against w = P L³ / 3D, and the reactions P and P L."""
    strip = sk.meshes.rectangle(length=1.0, width=0.2, cells=(16, 3))
    tip = strip.vertices[:, 0] > 0.99
    thickness, force = 0.02, 4e-10
    energy = sk.StVenantKirchhoff.from_young(1.0, 0.0) + sk.Bending.from_young(1.0, 0.0, directors="free")
    energy += EdgeLoad(tip, jnp.array([0.0, 0.0, force]))
    problem = sk.InverseProblem(strip, thickness, energy, supports=Clamped(lambda x: x[:, 0] < 0.01))
    equilibrium = problem()
    deflection = float(jnp.mean((equilibrium.vertices - strip.vertices)[tip, 2]))
    np.testing.assert_allclose(deflection, force / 3 / (0.2 * thickness**3 / 12), rtol=5e-3)
    np.testing.assert_allclose(jnp.sum(equilibrium.reactions, axis=0), [0, 0, -force], atol=1e-6 * force)
    held = jnp.isclose(strip.vertices[:, 0], 0.0)
    root = held[strip.edges].all(axis=1)
    np.testing.assert_array_equal(equilibrium.moments[~root], 0.0)
    # The moment of the force about the root is -P L along y: the clamp acts with the opposite.
    np.testing.assert_allclose(jnp.sum(equilibrium.moments, axis=0), [0, force, 0], atol=1e-4 * force)


@pytest.mark.slow
def test_clamped_square_plate_converges_with_the_second_order():
    """w0 = 0.00126532 q L⁴ / D in the middle, whatever Poisson's ratio is. A quarter of the plate, on an irregular
    mesh."""
    thickness = 0.01
    stiffness = thickness**3 / 12
    errors = []
    for n in (4, 8):
        mesh = sk.meshes.rectangle(length=0.5, width=0.5, cells=(n, n), diagonals="jittered")
        x = mesh.vertices
        supports = Clamped((x[:, 0] < 1e-9) | (x[:, 1] < 1e-9))
        supports += Symmetry(x[:, 0] > 0.499, normal="x") + Symmetry(x[:, 1] > 0.499, normal="y")
        energy = sk.StVenantKirchhoff.from_young(1.0, 0.0) + sk.Bending.from_young(1.0, 0.0, directors="free")
        load = 1e-4 * stiffness
        equilibrium = sk.InverseProblem(mesh, thickness, energy + SurfaceLoad([0.0, 0.0, load]), supports=supports)()
        errors.append(float(equilibrium.vertices[-1, 2]) / (0.00126532 * load / stiffness) - 1)
    assert 0 < errors[1] < 0.11 and 3.2 < errors[0] / errors[1] < 5


@pytest.mark.slow
def test_equilibria_have_derivatives_in_what_is_prescribed():
    mesh = dome((3, 3))
    supports = Clamped(EDGE, rotation=jnp.array([0.0, 0.1, 0.0])) + Pinned(
        [15], displacement=jnp.array([0.0, 0.0, 0.05])
    )
    problem = shell(mesh, supports)
    where = lambda p: (p.supports.terms[0].rotation, p.supports.terms[1].displacement)

    @eqx.filter_jit
    def shape(values):
        return jnp.sum(jnp.sin(5 * eqx.tree_at(where, problem, values)().vertices))

    values = where(problem)
    direction = (jnp.array([0.3, -0.5, 0.2]), jnp.array([0.1, 0.4, -0.7]))
    gradient = jax.grad(shape)(values)
    slope = sum(jnp.vdot(g, d) for g, d in zip(gradient, direction, strict=True))
    moved = lambda step: shape(jax.tree.map(lambda v, d: v + step * d, values, direction))
    np.testing.assert_allclose((moved(1e-4) - moved(-1e-4)) / 2e-4, slope, rtol=1e-5)
