"""The design problems of `benchmarks.scene`, in shellkit."""

import jax
import jax.numpy as jnp

import shellkit as sk

from ..scene import FOLDS, SMOOTHNESS_OF, THICKNESS, ellipsoid, fields


def bilayer(top: jax.Array, bottom: jax.Array, stretch: float) -> sk.Bilayer:
    return sk.Bilayer(top=sk.Nematic(angle=top, stretch=stretch), bottom=sk.Nematic(angle=bottom, stretch=stretch))


def director_angles(problem: sk.InverseProblem) -> tuple[jax.Array, jax.Array]:
    """The arrays that a design step trains."""
    assert isinstance(problem.actuation, sk.Bilayer)
    return problem.actuation.top.angle, problem.actuation.bottom.angle


def tutorial_loss(name: str, mesh: sk.Mesh) -> sk.Loss:
    smoothness = SMOOTHNESS_OF[name] * sk.DirectorSmoothness()
    if name == "ellipsoid":
        return sk.VertexDistance(ellipsoid(mesh.vertices), aligner=sk.Kabsch()) + smoothness
    return sk.Sphericity() + FOLDS * sk.FoldPenalty() + smoothness


def design_problem(mesh: sk.Mesh, loss: str, stretch: float, field: str, form: str = "sin") -> sk.InverseProblem:
    """The ellipsoid or the sphericity problem on a mesh, at the director field of that name."""
    stretching = sk.NeoHookean(bulk=1.0, shear=1.0) if loss == "sphericity" else sk.StVenantKirchhoff(1.0, 1.0)
    return sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        energy=stretching + sk.Bending(1.0, 1.0, form=form),
        actuation=bilayer(*fields(field, mesh.n_faces), stretch),
        loss=tutorial_loss(loss, mesh),
    )


def teacher(mesh: sk.Mesh) -> sk.InverseProblem:
    """The tutorial's teacher: directors along z on top and across below, stretch 1.1. The shell buckles."""
    along = sk.director_angles(mesh, jnp.array([0.0, 0.0, 1.0]))
    return sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        energy=sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0),
        actuation=bilayer(along, along + jnp.pi / 2, 1.1),
        loss=tutorial_loss("ellipsoid", mesh),
    )
