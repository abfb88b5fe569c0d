"""A membrane sphere that shrinks, grows or is pushed apart at its poles: along a ramp that adapts, and at once."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

import shellkit as sk


class Strut(sk.EnergyTerm):
    """A rod that pushes two vertices apart with a constant force. Counts how often it is traced."""

    traces: ClassVar[list[None]] = []
    force: Array

    def stencil(self, mesh):
        z = np.asarray(mesh.vertices[:, 2])
        return np.array([[z.argmax(), z.argmin()]])

    def element_data(self, mesh, rest):
        self.traces.append(None)
        return None

    def element_energy(self, x, data):
        return -self.force * jnp.linalg.norm(x[0] - x[1])

    def at(self, progress):
        return Strut(progress * self.force)


MESH = sk.meshes.icosphere(subdivisions=1)
MEMBRANE = sk.StVenantKirchhoff(alpha=1.0, beta=1.0)


def sphere(stretch=1.0, force=0.0, steps=5):
    """Relaxations can be cut off after so few steps that a sphere must grow little by little: its faces come under
    pressure, which makes them unstable."""
    return sk.InverseProblem(
        mesh=MESH,
        thickness=0.1,
        actuation=sk.IsotropicGrowth(stretch=stretch),
        energy=MEMBRANE + Strut(jnp.asarray(force)),
        solver=sk.SparseNewton(max_steps=steps),
    )


def radius(problem, path):
    return jnp.mean(jnp.linalg.norm(sk.relax(problem, path).vertices, axis=1))


@pytest.fixture(scope="module")
def shrunk():
    """Every edge of the membrane has its rest length once all of it has shrunk by the same factor."""
    return sk.follow(sphere(stretch=0.8), sk.Ramp(4))


def test_a_ramp_takes_even_steps(shrunk):
    assert shrunk.complete and shrunk.failures == ()
    np.testing.assert_allclose(shrunk.progress, [0.25, 0.5, 0.75, 1.0], rtol=1e-12)


def test_each_equilibrium_is_that_of_its_moment(shrunk):
    factors = 1 - 0.2 * shrunk.progress
    np.testing.assert_allclose(shrunk.vertices, factors[:, None, None] * MESH.vertices, atol=1e-10)
    np.testing.assert_allclose(shrunk.energies, 0.0, atol=1e-18)


def test_a_table_of_the_path(shrunk):
    assert len(str(shrunk).splitlines()) == 5


def test_loads_come_on_with_progress():
    path = sk.follow(sphere(force=4e-3), sk.Ramp(2))
    assert path.complete
    rest = sk.RestShape.of(MESH, jnp.asarray(0.1), None)
    top, bottom = np.asarray(Strut(jnp.zeros(())).stencil(MESH))[0]
    for progress, vertices in zip(path.progress, path.vertices, strict=True):
        axis = vertices[top] - vertices[bottom]
        expected = jnp.zeros_like(vertices).at[top].set(axis).at[bottom].set(-axis) / jnp.linalg.norm(axis)
        forces = jax.grad(stretching_energy)(vertices, rest.metric)
        np.testing.assert_allclose(forces, progress * 4e-3 * expected, atol=1e-12)


def stretching_energy(vertices, metric):
    """The formula of the tutorial, face by face, for the moduli and the thickness of these tests."""
    a, b, c = (vertices[MESH.faces[:, corner]] for corner in range(3))
    edges = jnp.stack([b - a, c - a], axis=1)
    strain = jnp.linalg.solve(metric, jnp.einsum("fik,fjk->fij", edges, edges)) - jnp.eye(2)
    trace, square = jnp.trace(strain, axis1=1, axis2=2), jnp.einsum("fij,fji->f", strain, strain)
    return jnp.sum(0.1 / 4 * 0.5 * jnp.sqrt(jnp.linalg.det(metric)) * (trace**2 + 2 * square))


def test_a_ramp_ends_where_a_relaxation_at_once_does():
    problem = sphere(stretch=0.95, force=4e-3)
    at_once, ramped = sk.relax(problem), sk.relax(problem, sk.Ramp(3))
    assert at_once.converged and ramped.converged
    np.testing.assert_allclose(ramped.vertices, at_once.vertices, atol=1e-9)
    np.testing.assert_allclose(ramped.energy, at_once.energy, rtol=1e-12)
    assert sk.relax(problem, sk.Ramp(3), start=at_once).converged


def test_steps_are_halved_where_a_relaxation_fails():
    path = sk.follow(sphere(stretch=3.0, steps=2), sk.Ramp(1))
    assert path.complete and len(path.failures) >= 2
    assert path.failures[0][0] == 1.0 and path.failures[1][0] == 0.5
    assert "steps" in path.failures[0][1]
    np.testing.assert_allclose(path.equilibria[-1].vertices, 3 * MESH.vertices, atol=1e-9)
    # They grow again, far beyond those that failed from rest: growth is along straight lines, which the ramp predicts.
    assert path.failures[-1][0] > path.progress[0] and np.diff(path.progress).max() > 8 * path.failures[-1][0]


def test_a_ramp_that_gives_up_says_where_and_why():
    problem, ramp = sphere(stretch=3.0, steps=2), sk.Ramp(1, halvings=0)
    path = sk.follow(problem, ramp)
    assert not path.complete and path.equilibria == () and [at for at, _ in path.failures] == [1.0]
    equilibrium = sk.relax(problem, ramp)
    assert not equilibrium.converged and "steps" in sk.RESULTS[equilibrium.result]


def test_one_program_serves_all_steps_and_all_ramps(shrunk):
    Strut.traces.clear()
    problem = sphere(stretch=0.9, force=1e-3)
    built = len(Strut.traces)
    sk.follow(problem, sk.Ramp(5))
    sk.relax(problem, sk.Ramp(3), start=shrunk.equilibria[0])
    assert len(Strut.traces) == built


def test_the_end_is_differentiable():
    problem = sphere(stretch=0.8)
    slope = eqx.filter_grad(radius)(problem, sk.Ramp(2)).actuation.stretch
    np.testing.assert_allclose(slope, 1.0, rtol=1e-9)


@pytest.mark.slow
def test_a_ramp_adapts_under_jit_too():
    value, gradient = eqx.filter_jit(eqx.filter_value_and_grad(radius))(sphere(stretch=3.0, steps=2), sk.Ramp(1))
    np.testing.assert_allclose([value, gradient.actuation.stretch], [3.0, 1.0], rtol=1e-9)


def test_following_under_jit_is_refused():
    with pytest.raises(ValueError, match="use relax"):
        eqx.filter_jit(lambda problem: sk.follow(problem).vertices)(sphere())


@pytest.mark.parametrize("arguments", [{"steps": 0}, {"halvings": -1}])
def test_a_ramp_of_no_steps_is_refused(arguments):
    with pytest.raises(ValueError, match="at least one step"):
        sk.Ramp(**arguments)
