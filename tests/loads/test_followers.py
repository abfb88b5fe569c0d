"""Pressure, edge moments and foundations against exact answers."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk
from shellkit import Clamped, EdgeMoment, Foundation, Pressure, SurfaceLoad
from shellkit._energy import Assembly, DiscreteEnergy, Unknowns
from shellkit._rest import RestShape


def discrete(term, mesh):
    assembly = Assembly.of(term, mesh)
    return DiscreteEnergy(term, mesh, RestShape.of(mesh, jnp.array(0.1), None), assembly, jnp.zeros(assembly.dofs.size))


def crumpled(mesh, size=0.1):
    return mesh.vertices + size * jax.random.normal(jax.random.key(1), mesh.vertices.shape)


def face_loads(shape, mesh, pressure):
    """A third of pressure times area, along the normal, at each corner."""
    force = (pressure * sk.face_areas(shape, mesh))[:, None] * sk.face_normals(shape, mesh)
    return jnp.zeros_like(shape).at[mesh.faces].add(jnp.repeat(force[:, None] / 3, 3, axis=1))


def test_pressure_on_a_closed_shell_is_its_area_normals():
    ball = sk.meshes.icosphere(subdivisions=1)
    energy, shape = discrete(Pressure(2.5), ball), crumpled(ball)
    forces = -energy.gradient(shape.reshape(-1)).reshape(-1, 3)
    np.testing.assert_allclose(forces, face_loads(shape, ball, 2.5), atol=1e-14)
    np.testing.assert_allclose(jnp.sum(forces, axis=0), 0.0, atol=1e-14)
    np.testing.assert_allclose(jnp.sum(jnp.cross(shape, forces), axis=0), 0.0, atol=1e-14)
    np.testing.assert_allclose(energy(shape.reshape(-1)), -2.5 * sk.enclosed_volume(shape, ball), rtol=1e-12)
    hessian = energy.hessian(shape.reshape(-1)).as_matrix()
    np.testing.assert_allclose(hessian, jax.jacfwd(energy.gradient)(shape.reshape(-1)), atol=1e-14)


def test_pressure_on_an_open_shell_is_its_area_normals_off_the_boundary():
    sheet = sk.meshes.rectangle(length=2.0, width=1.0, cells=(4, 3))
    shape, inside = crumpled(sheet), ~sheet.boundary_vertices
    for apex in (None, jnp.array([0.3, 0.2, -5.0])):
        forces = -discrete(Pressure(2.5, apex), sheet).gradient(shape.reshape(-1)).reshape(-1, 3)
        np.testing.assert_allclose(forces[inside], face_loads(shape, sheet, 2.5)[inside], atol=1e-13)


def test_pressure_on_a_part_of_a_sphere_in_planes_through_the_apex():
    """An octant with its boundary in three planes through the centre: the components within the planes are exact
    too."""
    flat = sk.meshes.rectangle(length=1.0, width=1.0, cells=(3, 3)).vertices
    quarter = sk.meshes.rectangle(length=1.0, width=1.0, cells=(3, 3))
    x, y = flat[:, 0], flat[:, 1]
    wedge = quarter.with_vertices(jnp.column_stack([jnp.cos(x) * jnp.cos(y), jnp.sin(x) * jnp.cos(y), jnp.sin(y)]))
    plane = jnp.isclose(y, 0.0) & (x > 0.1) & (x < 0.9)
    apex = jnp.zeros(3)
    forces = -discrete(Pressure(1.0, apex), wedge).gradient(wedge.vertices.reshape(-1)).reshape(-1, 3)
    np.testing.assert_allclose(forces[plane, :2], face_loads(wedge.vertices, wedge, 1.0)[plane, :2], atol=1e-14)


@pytest.mark.slow
def test_pressurised_sphere():
    """Card 2 of the literature: (α+β) 4h [ρ³ − ρ + η(ρ − 1)] = p R ρ², η = h²/6R²."""
    ball = sk.meshes.icosphere(subdivisions=2)
    energy = sk.StVenantKirchhoff.from_young(1.0, 0.3) + sk.Bending.from_young(1.0, 0.3) + Pressure(1e-3)
    equilibrium = sk.InverseProblem(ball, 0.01, energy)()
    assert equilibrium.converged
    radii = jnp.linalg.norm(equilibrium.vertices - equilibrium.vertices.mean(axis=0), axis=1)
    assert abs(float(radii.mean()) - 1.0356120262) < 2e-3


def strip(length=10.0, cells=(30, 3)):
    mesh = sk.meshes.rectangle(length=length, width=1.0, cells=cells)
    return mesh, mesh.vertices[:, 0] > length - 1e-6


@pytest.mark.parametrize("centre", [0.0, 2.0])
def test_edge_moment_works_on_the_angle(centre):
    mesh, tip = strip(cells=(5, 2))
    energy = discrete(EdgeMoment(tip, 3.0, centre=centre), mesh)
    for angle in (-1.0, 0.0, 0.7, 2.5):
        # About -y, so that the tip's normal leans towards +x for a negative angle: the sheet's outward side.
        c, s = np.cos(angle), np.sin(angle)
        turn = jnp.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        np.testing.assert_allclose(energy((mesh.vertices @ turn.T).reshape(-1)), -3.0 * angle, atol=1e-13)
    forces = -energy.gradient(mesh.vertices.reshape(-1)).reshape(-1, 3)
    np.testing.assert_allclose(jnp.sum(forces, axis=0), 0.0, atol=1e-14)
    np.testing.assert_allclose(jnp.sum(jnp.cross(mesh.vertices, forces), axis=0), [0.0, 3.0, 0.0], atol=1e-13)


@pytest.mark.slow
def test_edge_moment_bends_a_strip_into_an_arc():
    """Curvature M / EI all along: a strip clamped at one end turns by M L / EI at the other."""
    young, thickness = 1.2e6, 0.1
    mesh, tip = strip()
    total = 1.0  # radians at the tip
    moment = total / 10.0 * young * thickness**3 / 12
    energy = sk.StVenantKirchhoff.from_young(young, 0.0) + sk.Bending.from_young(young, 0.0, directors="free")
    root = mesh.vertices[:, 0] < 1e-6
    problem = sk.InverseProblem(mesh, thickness, energy + EdgeMoment(tip, moment), supports=Clamped(root))
    relax = eqx.filter_jit(lambda p, start: p(start))
    equilibrium = None
    for part in (0.5, 1.0):
        equilibrium = relax(problem.at(jnp.array(part)), equilibrium)
    assert equilibrium.converged
    end = (equilibrium.vertices[tip]).mean(axis=0)
    exact = 10.0 * jnp.array([jnp.sin(total) / total, 0.05, (jnp.cos(total) - 1) / total])
    np.testing.assert_allclose(end, exact, atol=0.01)


def test_edge_moment_on_a_held_normal_is_refused():
    mesh, tip = strip(cells=(4, 2))
    energy = sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0, directors="free") + EdgeMoment(tip, 1.0)
    with pytest.raises(ValueError, match=r"EdgeMoment: the normal of the edge .* is held by a support"):
        sk.InverseProblem(mesh, 0.1, energy, supports=Clamped(tip))
    sk.InverseProblem(mesh, 0.1, energy, supports=sk.Pinned(tip))


def test_foundation_is_a_spring():
    sheet = sk.meshes.rectangle(length=2.0, width=1.0, cells=(4, 3))
    shift = jnp.array([0.1, 0.2, -0.3])
    moved = (sheet.vertices + shift).reshape(-1)
    np.testing.assert_allclose(discrete(Foundation(5.0), sheet)(moved), 0.5 * 5.0 * 2.0 * shift @ shift, rtol=1e-12)
    winkler = Foundation(5.0, direction=[0.0, 0.0, 2.0])
    np.testing.assert_allclose(discrete(winkler, sheet)(moved), 0.5 * 5.0 * 2.0 * 0.09, rtol=1e-12)
    elsewhere = Foundation(5.0, positions=sheet.vertices + shift)
    np.testing.assert_allclose(discrete(elsewhere, sheet)(moved), 0.0, atol=1e-15)
    some = Foundation(jnp.arange(20.0), vertices=[3])
    expected = 0.5 * 3.0 * sk.vertex_areas(sheet.vertices, sheet)[3] * shift @ shift
    np.testing.assert_allclose(discrete(some, sheet)(moved), expected, rtol=1e-12)


def test_sheet_on_a_foundation_sinks_by_load_over_stiffness():
    sheet = sk.meshes.rectangle(length=2.0, width=1.0, cells=(4, 3))
    energy = sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0, directors="free")
    problem = sk.InverseProblem(sheet, 0.1, energy + Foundation(4.0) + SurfaceLoad([0.0, 0.0, -0.01]))
    equilibrium = problem()
    assert equilibrium.converged
    unknowns = problem.assembly.dofs.gather(Unknowns(sheet.vertices))
    assert not np.any(problem.rigid_modes()(unknowns))
    # A vertex's share of load and of springs is its area alike, so that it sinks evenly.
    np.testing.assert_allclose(
        equilibrium.vertices - sheet.vertices, jnp.zeros((20, 3)).at[:, 2].set(-0.0025), atol=1e-12
    )


@pytest.mark.parametrize(
    ("term", "message"),
    [
        (Pressure(jnp.ones(3)), "one finite number"),
        (Pressure(1.0, apex=jnp.ones(2)), "apex"),
        (Foundation(-1.0), "negative"),
        (Foundation(jnp.ones(3)), r"stiffness has shape \(3,\)"),
        (Foundation(1.0, positions=jnp.ones((2, 3))), r"positions has shape \(2, 3\)"),
        (Foundation(1.0, direction=[0.0, 0.0, 0.0]), "not zero"),
        (EdgeMoment([6, 7, 8], 1.0), r"edge between the vertices \[7, 6\] is not on the boundary"),
        (EdgeMoment([0, 1], jnp.ones(2)), "moment is"),
    ],
)
def test_refusals(term, message):
    with pytest.raises(ValueError, match=message):
        term.check(sk.meshes.rectangle(length=2.0, width=1.0, cells=(4, 3)))
