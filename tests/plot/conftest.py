"""A sphere, and an equilibrium of it as a relaxation would return it."""

import jax.numpy as jnp
import optimistix as optx
import pytest

import shellkit as sk


@pytest.fixture(scope="session")
def sphere():
    return sk.meshes.icosphere(subdivisions=1)


@pytest.fixture(scope="session")
def actuation(sphere):
    """Directors that differ from face to face and from layer to layer."""
    angle = jnp.linspace(0.0, 3.0, sphere.n_faces)
    return sk.Bilayer(top=sk.Nematic(angle=angle, stretch=1.2), bottom=sk.Nematic(angle=-angle, stretch=1.2))


@pytest.fixture(scope="session")
def equilibrium_of():
    """The vertices as if they were relaxed; only what pictures look at means anything."""

    def build(mesh, vertices, actuation=None):
        rest = sk.RestShape.of(mesh, jnp.asarray(0.1), "sin")
        zero, yes = jnp.zeros(()), jnp.array(True)
        return sk.Equilibrium(
            mesh=mesh,
            rest=rest if actuation is None else actuation(rest),
            vertices=vertices,
            directors=None,
            reactions=None,
            moments=None,
            multipliers=None,
            energy=zero,
            gradient_norm=zero,
            steps=jnp.zeros((), jnp.int32),
            factorisations=jnp.zeros((), jnp.int32),
            converged=yes,
            stable=yes,
            result=optx.RESULTS.successful,
            worst_hinge=None,
        )

    return build


@pytest.fixture(scope="session")
def moved(sphere, actuation, equilibrium_of):
    """Stretched along z, then turned and shifted."""
    vertices = sphere.vertices * jnp.array([0.9, 0.9, 1.3])
    turn = jnp.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return equilibrium_of(sphere, vertices @ turn + jnp.array([3.0, 0.0, 0.0]), actuation)


@pytest.fixture(scope="session")
def problem(sphere, actuation):
    return sk.InverseProblem(
        mesh=sphere,
        thickness=0.1,
        actuation=actuation,
        energy=sk.StVenantKirchhoff(alpha=1.0, beta=1.0),
        loss=1e-3 * sk.DirectorSmoothness() + 2.0 * sk.VertexDistance(sphere.vertices * 1.5, aligner=sk.NoAlignment()),
    )


@pytest.fixture(scope="session")
def result(problem, moved):
    """A fit whose best design has relaxed to `moved`."""
    columns = {
        "loss": [1.0, 0.5, 0.25],
        "VertexDistance": [0.4, 0.2, 0.0],
        "refused": [0, 1, 0],
        "seconds": [1.0, 3.0, 5.0],
    }
    return sk.FitResult(
        problem=problem,
        best_loss=0.2,
        best_step=3,
        equilibrium=moved,
        last_problem=problem,
        history=sk.History(columns),
        stopped="steps",
        state=None,
    )
