"""Dead loads: their totals, their work, and that they add nothing to the matrix."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk
from shellkit._energy import Assembly, DiscreteEnergy
from shellkit._energy.loads.dead import EdgeLoad, Gravity, PointLoad, SurfaceLoad
from shellkit._rest import RestShape


SHEET = sk.meshes.rectangle(length=2.0, width=1.0, cells=(4, 3), diagonals="jittered")
X = SHEET.vertices
REST = RestShape.of(SHEET, jnp.linspace(0.1, 0.2, SHEET.n_faces), None)
TIP = X[:, 0] > 1.99
FORCE = jnp.array([1.0, -2.0, 3.0])


def forces(load, mesh=SHEET, rest=REST):
    """Minus the gradient of the energy, at some other shape."""
    assembly = Assembly.of(load, mesh)
    energy = DiscreteEnergy(load, mesh, rest, assembly, jnp.zeros(assembly.dofs.size))
    shape = mesh.vertices + jax.random.normal(jax.random.key(0), mesh.vertices.shape)
    shift = jnp.array([0.3, 0.1, -0.7])
    # Work is force times displacement, from the shape at rest on.
    np.testing.assert_allclose(energy(mesh.vertices.reshape(-1)), 0.0, atol=1e-15)
    found = -energy.gradient(shape.reshape(-1)).reshape(-1, 3)
    np.testing.assert_allclose(energy(shape.reshape(-1)), -jnp.sum(found * (shape - mesh.vertices)), rtol=1e-12)
    np.testing.assert_allclose(energy((mesh.vertices + shift).reshape(-1)), -jnp.sum(found, axis=0) @ shift, rtol=1e-12)
    return found


@pytest.mark.parametrize(
    ("load", "total"),
    [
        (SurfaceLoad(FORCE), 2.0 * FORCE),
        (SurfaceLoad(jnp.outer(jnp.arange(24.0), FORCE)), None),
        (Gravity(density=5.0), None),
        (Gravity(density=jnp.arange(24.0), acceleration=FORCE), None),
        (PointLoad(7, FORCE), FORCE),
        (PointLoad([7, 2], jnp.stack([FORCE, FORCE])), 2 * FORCE),
        (PointLoad(TIP, FORCE), 4 * FORCE),
        (EdgeLoad(TIP, FORCE), FORCE),
        (2.0 * EdgeLoad(TIP, FORCE) + PointLoad(3, FORCE), 3 * FORCE),
    ],
)
def test_total_force_is_what_was_asked_for(load, total):
    if total is None:
        area = sk.face_areas(X, SHEET)
        per_area = (
            load.force if isinstance(load, SurfaceLoad) else jnp.outer(load.density * REST.thickness, load.acceleration)
        )
        total = area @ per_area
    np.testing.assert_allclose(jnp.sum(forces(load), axis=0), total, rtol=1e-12, atol=1e-14)


class Wind(sk.DeadLoad):
    """As the docstring of `DeadLoad` has it."""

    pressure: jax.Array

    def nodal_forces(self, mesh, rest):
        return self.pressure * sk.vertex_areas(mesh.vertices, mesh)[:, None] * jnp.array([1.0, 0.0, 0.0])


def test_a_load_of_ones_own():
    found = forces(Wind(jnp.asarray(3.0)))
    np.testing.assert_allclose(found, 3.0 * sk.vertex_areas(X, SHEET)[:, None] * jnp.array([1.0, 0.0, 0.0]), rtol=1e-12)
    np.testing.assert_allclose(forces(Wind(jnp.asarray(3.0)).at(0.5)), 0.5 * found, rtol=1e-12)


def test_surface_loads_act_at_the_centres_of_faces():
    load = jnp.outer(jnp.arange(1.0, 25.0), FORCE)
    centres = X[SHEET.faces].mean(axis=1)
    expected = jnp.sum(jnp.cross(centres, sk.face_areas(X, SHEET)[:, None] * load), axis=0)
    np.testing.assert_allclose(jnp.sum(jnp.cross(X, forces(SurfaceLoad(load))), axis=0), expected, rtol=1e-12)


def test_edge_load_is_spread_by_length():
    uneven = SHEET.with_vertices(jnp.column_stack([X[:, 0], X[:, 1] ** 2, X[:, 2]]))
    found = forces(EdgeLoad(TIP, FORCE), uneven)
    assert not jnp.any(found[~TIP])
    # An even line load of total F along y in [0, 1] has the moment F / 2 about y = 0.
    np.testing.assert_allclose(uneven.vertices[:, 1] @ found, 0.5 * FORCE, rtol=1e-12)


def test_edge_load_on_a_line_inside_the_sheet():
    line = sk.meshes.rectangle(length=2.0, width=1.0, cells=(4, 3))
    middle = jnp.isclose(line.vertices[:, 0], 1.0)
    found = forces(EdgeLoad(middle, FORCE), line)
    np.testing.assert_allclose(jnp.sum(found, axis=0), FORCE, rtol=1e-12)
    assert jnp.all(jnp.any(found != 0, axis=1) == middle)


def test_edge_load_leaves_diagonals_that_cut_a_corner_alone():
    rim = SHEET.boundary_vertices
    arms = X[SHEET.edges[:, 1]] - X[SHEET.edges[:, 0]]
    lengths = jnp.where(SHEET.boundary_edges, jnp.linalg.norm(arms, axis=1), 0.0)
    expected = jnp.zeros(SHEET.n_vertices).at[SHEET.edges].add(0.5 * lengths[:, None] / 6.0)
    np.testing.assert_allclose(forces(EdgeLoad(rim, FORCE)), jnp.outer(expected, FORCE), atol=1e-14)


def test_loads_add_nothing_to_the_matrix():
    energy = sk.StVenantKirchhoff(1.0, 1.0)
    bare, loaded = (Assembly.of(e, SHEET) for e in (energy, energy + Gravity(1.0) + EdgeLoad(TIP, FORCE)))
    assert bare.pattern.nnz == loaded.pattern.nnz and loaded.element_entries == (None, None)


def test_loads_grow_along_a_path():
    energy = (Gravity(1.0) + 2.0 * PointLoad(3, FORCE)).at(0.25)
    np.testing.assert_allclose(forces(energy), 0.25 * forces(Gravity(1.0) + 2.0 * PointLoad(3, FORCE)), atol=1e-15)


@pytest.mark.parametrize(
    ("load", "message"),
    [
        (SurfaceLoad(jnp.zeros((3, 2))), r"force has shape \(3, 2\); expected \(3,\) or \(24, 3\)"),
        (Gravity(jnp.ones(3)), r"density has shape \(3,\); expected \(\) or \(24,\)"),
        (Gravity(1.0, acceleration=[0.0, jnp.inf, 0.0]), "acceleration is not finite"),
        (PointLoad(99, FORCE), "no vertex 99"),
        (PointLoad([1, 2], jnp.zeros((3, 3))), r"force has shape \(3, 3\); expected \(3,\) or \(2, 3\)"),
        (EdgeLoad([0], FORCE), "no edge of the mesh has both its ends selected"),
        (EdgeLoad(TIP, 1.0), r"force has shape \(\); expected \(3,\)"),
    ],
)
def test_refusals(load, message):
    with pytest.raises(ValueError, match=message):
        load.check(SHEET)
