"""Directors as a function of place."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

import shellkit as sk


COARSE, FINE = sk.meshes.icosphere(0), sk.meshes.icosphere(1)


class Uniform(eqx.Module):
    """The tensor nn^T of one direction in space, wherever it is asked for."""

    direction: jax.Array

    def __call__(self, x):
        n = self.direction
        return jnp.stack([n[0] * n[0], n[1] * n[1], n[2] * n[2], n[1] * n[2], n[2] * n[0], n[0] * n[1]])


@pytest.mark.parametrize("mesh", [COARSE, FINE], ids=["coarse", "fine"])
def test_a_direction_in_space_is_laid_onto_each_face(mesh):
    """The largest part of nn^T in a plane is along the projection of n: what `director_angles` gives."""
    axis = jnp.array([0.3, -0.5, 0.8])
    found = sk.NeuralDirectors(Uniform(axis), 1.1).angles(mesh)
    wanted = sk.director_angles(mesh, axis)
    assert np.allclose(np.cos(2 * (found - wanted)), 1.0, atol=1e-12)


def test_half_a_turn_is_the_same_field():
    axis = jnp.array([0.3, -0.5, 0.8])
    angles = [sk.NeuralDirectors(Uniform(sign * axis), 1.1).angles(COARSE) for sign in (1.0, -1.0)]
    assert np.array_equal(*angles)


def test_no_direction_has_no_derivative_and_no_nan():
    value, slope = jax.value_and_grad(lambda a: jnp.sum(sk.NeuralDirectors(Uniform(a), 1.1).angles(COARSE)))(
        jnp.zeros(3)
    )
    assert float(value) == 0.0 and np.array_equal(slope, jnp.zeros(3))


def problem(mesh, actuation, loss=None):
    material = sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0)
    return sk.InverseProblem(mesh, 0.2, material, actuation, loss)


@pytest.mark.parametrize("layers", ["sheet", "bilayer", "laminate"])
def test_relaxes_as_the_same_angles_do(layers):
    axis = jnp.array([0.3, -0.5, 0.8])
    neural, plain = sk.NeuralDirectors(Uniform(axis), 1.1), sk.Nematic(sk.director_angles(COARSE, axis), 1.1)
    build = {
        "sheet": lambda sheet: sheet,
        "bilayer": lambda sheet: sk.Bilayer(sheet, sk.Passive()),
        "laminate": lambda sheet: sk.Laminate([sk.Layer(sheet), sk.Layer(thickness=2.0)]),
    }[layers]
    found, wanted = problem(COARSE, build(neural))(), problem(COARSE, build(plain))()
    assert np.allclose(found.vertices, wanted.vertices, atol=1e-10)
    halfway = problem(COARSE, build(neural)).at(0.5)()
    assert np.allclose(halfway.vertices, problem(COARSE, build(plain)).at(0.5)().vertices, atol=1e-10)


def test_weights_are_trained_and_move_to_a_finer_mesh():
    network = eqx.nn.MLP(3, 6, width_size=8, depth=1, activation=jnp.sin, key=jax.random.key(0))
    target = lambda mesh: sk.VertexDistance(mesh.vertices * jnp.array([0.95, 0.95, 1.1]), aligner=sk.Kabsch())
    smooth = sk.DirectorSmoothness()
    coarse = problem(COARSE, sk.NeuralDirectors(network, 1.1), target(COARSE) + 1e-4 * smooth)
    result = sk.fit(coarse, optax.adam(0.02), steps=5, where=lambda p: p.actuation.field, progress=False)
    assert result.best_loss < float(coarse.evaluate()[0])
    finer = result.problem.replace(mesh=FINE, loss=target(FINE))
    before = coarse.replace(mesh=FINE, loss=target(FINE))
    assert float(finer.evaluate()[0]) < float(before.evaluate()[0])


def test_a_field_of_another_kind_is_refused():
    with pytest.raises(ValueError, match=r"gives \(3,\) at a place; it must give six numbers"):
        problem(COARSE, sk.NeuralDirectors(lambda x: x, 1.1))
    with pytest.raises(ValueError, match=r"length is 0\.0"):
        problem(COARSE, sk.NeuralDirectors(Uniform(jnp.ones(3)), 1.1, length=0.0))
    with pytest.raises(ValueError, match="use on\\(mesh\\) first"):
        sk.NeuralDirectors(Uniform(jnp.ones(3)), 1.1).actuated_metric(jnp.eye(2)[None])
