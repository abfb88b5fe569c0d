"""An equilibrium as a relaxation would return it, of any shape."""

import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

import shellkit as sk


def equilibrium_at(mesh, vertices, rest_metric=None):
    """The vertices as if they were relaxed; only what losses look at means anything."""
    u, v = (mesh.vertices[mesh.faces[:, k]] - mesh.vertices[mesh.faces[:, 0]] for k in (1, 2))
    if rest_metric is None:
        rows = [[jnp.sum(a * b, axis=1) for b in (u, v)] for a in (u, v)]
        rest_metric = jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)
    return sk.Equilibrium(
        mesh=mesh,
        rest=sk.RestShape(rest_metric, None, jnp.full(mesh.n_faces, 0.1)),
        vertices=jnp.asarray(vertices),
        directors=None,
        reactions=None,
        moments=None,
        multipliers=None,
        energy=jnp.asarray(0.0),
        gradient_norm=jnp.asarray(0.0),
        steps=jnp.asarray(0),
        factorisations=jnp.asarray(0),
        converged=jnp.asarray(True),
        stable=jnp.asarray(True),
        result=optx.RESULTS.successful,
        worst_hinge=None,
    )


@pytest.fixture(scope="session")
def at():
    return equilibrium_at


@pytest.fixture(scope="session")
def sphere():
    return sk.meshes.icosphere(subdivisions=1)


@pytest.fixture(scope="session")
def sheet():
    """Open, with vertices off the boundary, and bent so that nothing vanishes."""
    flat = sk.meshes.rectangle(2.0, 1.5, cells=(4, 3))
    return flat.with_vertices(flat.vertices.at[:, 2].set(0.3 * jnp.sin(2 * flat.vertices[:, 0]) * flat.vertices[:, 1]))


@pytest.fixture(scope="session")
def bilayer():
    """Two layers of random directors on any mesh."""

    def build(mesh, seed=0):
        angles = np.random.default_rng(seed).uniform(0, np.pi, (2, mesh.n_faces))
        top, bottom = (sk.Nematic(angle=jnp.asarray(layer), stretch=jnp.asarray(1.1)) for layer in angles)
        return sk.Bilayer(top=top, bottom=bottom)

    return build
