"""The numbers of the design problems, shared by shellkit and its peer so that both solve the same ones: those of
triangulax's tutorial on inverse problems. Needs nothing but JAX."""

import jax
import jax.numpy as jnp
import numpy as np


THICKNESS = 0.1
FOLDS = 1e-4  # weight of the penalty on folds, in the sphericity problem
SMOOTHNESS_OF = {"ellipsoid": 1e-3, "sphericity": 1e-2}  # weight of the smoothness of the directors

# A unit square that would like to roll up about an axis that lies askew to its edges; E = 1, ν = 0.3.
ROLL_THICKNESS = 0.02
ROLL_CURVATURE, ROLL_ANGLE = 2.0, np.pi / 6
ROLL_ALPHA, ROLL_BETA = 0.3 / (2 * (1 - 0.3**2)), 1 / (4 * (1 + 0.3))


def ellipsoid(vertices: jax.Array) -> jax.Array:
    """The target of the ellipsoid problem: the sphere, stretched along z."""
    return vertices * jnp.array([0.95, 0.95, 1.2])


def fields(name: str, n_faces: int) -> tuple[jax.Array, jax.Array]:
    """Director angles of top and bottom layer: all `"zero"`, where the tutorial's training begins, or `"random"`."""
    if name == "zero":
        return jnp.zeros(n_faces), jnp.zeros(n_faces)
    top, bottom = np.random.default_rng(0).uniform(0, np.pi, (2, n_faces))
    return jnp.asarray(top), jnp.asarray(bottom)


def shape_probes(vertices: jax.Array, count: int = 64) -> list[float]:
    """The distances of a few fixed pairs of vertices, by which shapes are compared, wherever they lie."""
    first, second = np.random.default_rng(2).integers(len(vertices), size=(2, count))
    points = np.asarray(vertices)
    return np.linalg.norm(points[first] - points[second], axis=1).tolist()


def gradient_probes(gradient: tuple[jax.Array, jax.Array], count: int = 16) -> list[float]:
    """The gradient along a few fixed random directions, by which those of two libraries are compared."""
    directions = np.random.default_rng(1).standard_normal((count, sum(map(len, gradient))))
    return (directions @ np.concatenate(gradient)).tolist()


def roll_curvature(vertices: jax.Array, faces: jax.Array) -> jax.Array:
    """The curvature form of the rolled square, in the basis of each face of the flat one."""
    along = jnp.array([np.cos(ROLL_ANGLE), np.sin(ROLL_ANGLE)])
    reach = jnp.stack([(vertices[faces[:, i]] - vertices[faces[:, 0]])[:, :2] @ along for i in (1, 2)], axis=1)
    return ROLL_CURVATURE * reach[:, :, None] * reach[:, None, :]


def rolled(vertices: jax.Array) -> jax.Array:
    """Where the vertices of the flat square go: onto a cylinder, without any stretch."""
    c, s = np.cos(ROLL_ANGLE), np.sin(ROLL_ANGLE)
    along, across = c * vertices[:, 0] + s * vertices[:, 1], c * vertices[:, 1] - s * vertices[:, 0]
    turn = ROLL_CURVATURE * along
    return jnp.stack([jnp.sin(turn), ROLL_CURVATURE * across, jnp.cos(turn)], axis=1) / ROLL_CURVATURE
