"""`jax.vmap` over a problem: the numbers of one by one, and nothing of a member in the others."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk


MESH = sk.meshes.icosphere(0)
MATERIAL = sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0)
TARGET = sk.VertexDistance(MESH.vertices * jnp.array([0.9, 0.9, 1.2]), aligner=sk.Kabsch())
PROBLEM = sk.InverseProblem(MESH, 0.2, MATERIAL, sk.Nematic(jnp.linspace(0.1, 1.0, MESH.n_faces), 1.2), TARGET)


def loss(where, value):
    return eqx.tree_at(where, PROBLEM, value).evaluate()[0]


PARTS = {
    "all of a shell": (
        lambda p: (p.actuation.angle, p.actuation.stretch, p.thickness, p.energy.terms[0].alpha, p.mesh.vertices),
        (
            jnp.linspace(0.0, 1.0, 3 * MESH.n_faces).reshape(3, -1),
            jnp.array([0.9, 1.1, 1.3]),
            jnp.array([0.1, 0.2, 0.3]),
            jnp.array([0.5, 1.0, 2.0]),
            jnp.stack([MESH.vertices * scale for scale in (0.9, 1.0, 1.1)]),
        ),
    ),
    "stretch alone": (lambda p: p.actuation.stretch, jnp.array([0.9, 1.1, 1.3])),
    "target": (lambda p: p.loss.target, jnp.stack([MESH.vertices * s for s in (0.9, 1.0, 1.1)])),
}


@pytest.mark.parametrize("name", PARTS)
def test_values_and_gradients_are_those_one_by_one(name):
    where, values = PARTS[name]
    one = jax.jit(lambda value: jax.value_and_grad(lambda v: loss(where, v))(value))
    found, gradients = jax.jit(jax.vmap(one))(values)
    for k in range(3):
        member = lambda tree, k=k: jax.tree.map(lambda leaf: leaf[k], tree)
        alone, gradient = one(member(values))
        assert float(found[k]) == pytest.approx(float(alone), rel=1e-11, abs=1e-15)
        for batched, single in zip(jax.tree.leaves(member(gradients)), jax.tree.leaves(gradient), strict=True):
            assert np.allclose(batched, single, rtol=1e-8, atol=1e-12)


def test_a_member_that_fails_changes_nothing_in_the_others():
    """Thickness NaN: no equilibrium; the others take the steps and factorisations that they take alone."""
    relax = lambda thickness: eqx.tree_at(lambda p: p.thickness, PROBLEM, thickness)()
    found = eqx.filter_vmap(relax)(jnp.array([0.1, jnp.nan, 0.3]))
    assert found.converged.tolist() == [True, False, True]
    for k, thickness in ((0, 0.1), (2, 0.3)):
        alone = eqx.filter_jit(relax)(jnp.asarray(thickness))
        assert np.allclose(found.vertices[k], alone.vertices, atol=1e-12)
        assert int(found.steps[k]) == int(alone.steps)
        assert int(found.factorisations[k]) == int(alone.factorisations)


def test_nested_and_in_a_scan():
    where = lambda p: p.actuation.stretch
    stretches = jnp.array([[0.9, 1.1], [1.2, 1.3]])
    flat = jax.vmap(lambda s: loss(where, s))(stretches.reshape(-1))
    nested = jax.vmap(jax.vmap(lambda s: loss(where, s)))(stretches)
    assert np.allclose(nested.reshape(-1), flat, rtol=1e-12)
    _, scanned = jax.lax.scan(lambda c, row: (c, jax.vmap(lambda s: loss(where, s))(row)), 0, stretches)
    assert np.allclose(scanned, nested, rtol=1e-12)


def test_gradient_of_a_mean_over_a_batch():
    """The other way round: the derivative of a vmap, in what all members share."""
    where = lambda p: (p.actuation.angle, p.actuation.stretch)
    stretches = jnp.array([1.1, 1.2])
    angles = PROBLEM.actuation.angle
    one = lambda a, s: eqx.tree_at(where, PROBLEM, (a, s)).evaluate()[0]
    batch = jax.grad(lambda a: jnp.mean(jax.vmap(lambda s: one(a, s))(stretches)))(angles)
    alone = sum(jax.grad(one)(angles, s) for s in stretches) / 2
    assert np.allclose(batch, alone, rtol=1e-9, atol=1e-13)


def test_products_with_the_jacobian():
    where = lambda p: p.actuation.angle
    shape = lambda a: eqx.tree_at(where, PROBLEM, a)().vertices
    angles = jnp.stack([PROBLEM.actuation.angle, PROBLEM.actuation.angle + 0.3])
    ahead = jnp.cos(jnp.arange(float(MESH.n_faces)))
    _, moved = jax.vmap(lambda a: jax.jvp(shape, (a,), (ahead,)))(angles)
    for k in range(2):
        assert np.allclose(moved[k], jax.jvp(shape, (angles[k],), (ahead,))[1], rtol=1e-8, atol=1e-11)


def test_supports_that_move():
    sheet = sk.meshes.rectangle(1.0, 1.0, cells=(3, 3))
    left = sheet.vertices[:, 0] < 1e-9
    problem = sk.InverseProblem(
        sheet, 0.2, MATERIAL + sk.Gravity(0.01), supports=sk.Clamped(np.asarray(left), displacement=[0.0, 0.0, 0.0])
    )
    shifted = lambda z: eqx.tree_at(lambda p: p.supports.displacement, problem, jnp.array([0.0, 0.0, 1.0]) * z)()
    found = jax.vmap(lambda z: shifted(z).vertices)(jnp.array([0.0, 0.5]))
    assert np.allclose(found[1] - found[0], jnp.array([0.0, 0.0, 0.5]), atol=1e-9)
