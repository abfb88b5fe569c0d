"""Making a Hessian convex: face by face, and as a whole."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk
from shellkit._energy import Unknowns
from shellkit._energy.discrete.convexity import convexifying_diagonal, negative_part


@pytest.mark.parametrize("k", [3, 6])
def test_indefinite_matrices_become_definite(k):
    rng = np.random.default_rng(k)
    half = rng.standard_normal((200, k, k))
    units = np.diag([1.0] * 3 + [1e4] * (k - 3))
    matrices = units @ (half + half.transpose(0, 2, 1)) @ units
    added = np.asarray(convexifying_diagonal(jnp.asarray(matrices.transpose(1, 2, 0)))).T
    mended = matrices + added[:, :, None] * np.eye(k)
    scaled = np.linalg.inv(units) @ mended @ np.linalg.inv(units)
    assert np.median(np.linalg.eigvalsh(matrices)[:, 0]) < 0
    assert np.linalg.eigvalsh(scaled)[:, 0].min() > 0
    # Much more than the negative curvature is not added.
    assert (
        np.linalg.eigvalsh(scaled)[:, -1].max() < 20 * np.abs(np.linalg.eigvalsh(half + half.transpose(0, 2, 1))).max()
    )


def test_definite_matrices_are_left_alone():
    half = np.random.default_rng(0).standard_normal((50, 6, 6))
    matrices = half @ half.transpose(0, 2, 1) + np.eye(6)
    np.testing.assert_array_less(np.abs(convexifying_diagonal(jnp.asarray(matrices.transpose(1, 2, 0)))), 1e-12)


@pytest.mark.parametrize("directors", ["average", "free"])
def test_a_crushed_shell_has_a_convex_model(directors):
    mesh = sk.meshes.icosphere(1)
    problem = sk.InverseProblem(
        mesh=mesh,
        thickness=0.1,
        actuation=sk.IsotropicGrowth(1.5),
        energy=sk.NeoHookean(bulk=1.0, shear=1.0) + sk.Bending(1.0, 1.0, directors=directors, form="tan"),
    )
    energy = problem.discrete_energy()
    noise = 0.05 * np.random.default_rng(1).standard_normal(mesh.vertices.shape)
    y = problem.assembly.dofs.gather(Unknowns(mesh.vertices + noise))
    hessian, lift = jax.jit(lambda y: (lambda _, __, h, c: (h.as_matrix(), c().as_matrix()))(*energy.derivatives(y)))(y)
    before, after = np.linalg.eigvalsh(hessian), np.linalg.eigvalsh(hessian + lift)
    assert before[0] < -1e-3 * before[-1]
    assert after[0] > -1e-12 * after[-1]
    # Only the rigid motions are left without stiffness.
    assert np.count_nonzero(after < 1e-10 * after[-1]) == 6


def test_elements_keep_the_positive_part():
    """Of a bar, the part across it goes where it is compressed, and none where it is not; motions stay free."""
    along = np.array([0.6, 0.0, 0.8])
    ends = np.kron([[1, -1], [-1, 1]], np.eye(3))
    axial = np.kron([[1, -1], [-1, 1]], np.outer(along, along))
    bar = lambda stiffness, force: stiffness * axial + force * (ends - axial)
    hessians = np.stack([bar(2.0, 0.5), bar(2.0, -0.5), bar(-2.0, -0.5)]).reshape(3, 2, 3, 2, 3)
    positive = (hessians + negative_part(jnp.asarray(hessians))).reshape(3, 6, 6)
    np.testing.assert_allclose(positive, [bar(2.0, 0.5), bar(2.0, 0.0), bar(0.0, 0.0)], atol=1e-14)
