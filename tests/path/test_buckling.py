"""Euler's strip: where its straight path is crossed, and the path that it buckles along, against the exact elastica."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipk

import shellkit as sk


WIDTH, THICKNESS, MOST = 0.2, 0.005, 1.2
EULER = np.pi**2 * WIDTH * THICKNESS**3 / 12  # π² B / L² with E = L = 1 and ν = 0


def strip(cells):
    """On hinges at both ends, the far one of which slides along the strip and is pressed by 1.2 times Euler's load."""
    mesh = sk.meshes.rectangle(1.0, WIDTH, cells=cells, diagonals="jittered", seed=0)
    x = mesh.vertices[:, 0]
    return sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        energy=sk.StVenantKirchhoff.from_young(1.0, 0.0)
        + sk.Bending.from_young(1.0, 0.0, directors="free")
        + sk.EdgeLoad(jnp.isclose(x, 1.0), force=[-MOST * EULER, 0.0, 0.0]),
        supports=sk.Pinned(jnp.isclose(x, 0.0)) + sk.Sliding(jnp.isclose(x, 1.0), along="x"),
    )


def elastica(rise):
    """The load, over Euler's, at which a strip has risen by so much of its length: w/L = k/K(k), P/P₁ = (2K/π)²."""
    modulus = brentq(lambda k: k / ellipk(k**2) - rise, 1e-9, 0.9)
    return (2 * ellipk(modulus**2) / np.pi) ** 2


@pytest.mark.slow
def test_a_strip_buckles_as_euler_says():
    errors = []
    for cells in ((8, 2), (16, 4)):
        problem = strip(cells)
        straight = sk.continue_path(problem, sk.ArcLength(first=0.4))
        assert straight.complete and int(straight.negative[-1]) == 1
        (point,) = straight.critical
        assert point.kind == "bifurcation"
        np.testing.assert_allclose(point.equilibrium.vertices[:, 2], 0.0, atol=1e-12)
        errors.append(abs(float(point.progress) * MOST - 1))
    assert errors[1] < 5e-3 and np.log2(errors[0] / errors[1]) > 1.7

    branch = sk.switch_branch(problem, point, 0.05, sk.ArcLength(steps=30, longest=2.0))
    assert branch.complete and bool((branch.negative == 0).all())
    rises = np.asarray(jnp.max(jnp.abs(branch.vertices[..., 2]), axis=1))
    loads = np.asarray(branch.progress) * MOST
    assert rises[-1] > 0.3
    np.testing.assert_allclose(loads, [elastica(rise) for rise in rises], rtol=1e-2)
