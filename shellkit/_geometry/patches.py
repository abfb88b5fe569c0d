"""The patch of a face and its three neighbours: edge lengths, hinge angles, and their first and second derivatives.

All arrays are index-last: (corner or edge, component, face). Edge i lies opposite corner i and runs from corner i + 1
to corner i + 2. The derivatives are written by hand, from the motion of a unit normal and of a height:

- with n the unit normal, h_i the height of corner i over edge i, and t_i the foot of that height along the edge, a
    hinge angle has the gradient -n / h_i at corner i, and the opposite, shared out as 1 - t_i and t_i, at the ends of
    the edge; each of its two faces adds such a part;
- its second derivative is the sum of one part a face, which involves that face's own corners only.

Tamstorf and Grinspun, "Discrete bending forces and their Jacobians", Graphical Models 75 (2013), give an equivalent
form.

An edge whose normal is held has, instead of the neighbour, the half plane into which the surface would go on: the angle
to it is a hinge angle of which only this face moves.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._mesh.mesh import Mesh
from .vectors import cross, dot, gather


# SIGN[i, p] = d(edge i)/d(corner p): edge i runs from corner i + 1 to corner i + 2.
SIGN = np.array([[0.0, -1.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0]])
CORNER_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


class Triangles(eqx.Module):
    """Edges, squared lengths and normals of all faces."""

    corners: Float[Array, "3 3 F"]
    edges: Float[Array, "3 3 F"]
    squared_lengths: Float[Array, "3 F"]
    area_normal: Float[Array, "3 F"]  # unit normal times twice the area
    twice_area: Float[Array, " F"]

    def __init__(self, vertices: Float[Array, "V 3"], mesh: Mesh):
        self.corners = gather(vertices, mesh.faces)
        self.edges = jnp.roll(self.corners, 1, axis=0) - jnp.roll(self.corners, 2, axis=0)
        self.squared_lengths = dot(self.edges, self.edges)
        self.area_normal = cross(self.edges[2], -self.edges[1])
        self.twice_area = jnp.sqrt(dot(self.area_normal, self.area_normal))

    @property
    def tails(self) -> Float[Array, "3 3 F"]:
        """Where each edge starts."""
        return jnp.roll(self.corners, 2, axis=0)

    def feet(self) -> Float[Array, "3 F"]:
        """Where the height of corner i meets edge i, from 0 at its tail to 1 at its head."""
        return dot(self.corners - self.tails, self.edges) / self.squared_lengths


class ClampedSide(eqx.Module):
    """How the surface goes on beyond the edges whose normal is held, seen from each of their faces.

    The edge normal is square to the edge and to the arm. Arms are unit vectors square to their edges, and stay so under
    all motions that the supports leave free: then the angle to them depends, to second order, on the near face alone.
    """

    listed: Bool[Array, "3 F"]  # whether the normal of edge i is held
    arms: Float[Array, "3 3 F"]


class Hinges(eqx.Module):
    """The three hinges of every face. On a boundary that nothing holds the angle and its derivatives are zero."""

    hinged: Float[Array, "3 F"]  # 1 where edge i has a face on its other side, or a held normal; else 0
    beyond: Float[Array, "3 F"]  # 1 where it has a face on its other side that the angle is measured against; else 0
    arms: Float[Array, "3 3 F"]  # far vertex seen from the tail of the edge
    far_area_normal: Float[Array, "3 3 F"]
    angles: Float[Array, "3 F"]  # positive where the surface is convex
    listed: Bool[Array, "3 F"] | None  # whether the normal of edge i is held; None if none is

    def __init__(
        self,
        vertices: Float[Array, "V 3"],
        mesh: Mesh,
        triangles: Triangles,
        continuation: ClampedSide | None = None,
    ):
        hinged = mesh.face_opposite.T >= 0
        far = gather(vertices, jnp.maximum(mesh.face_opposite, 0))
        self.arms = far - triangles.tails
        self.beyond = jnp.where(hinged, 1.0, 0.0).astype(vertices.dtype)
        self.hinged, self.listed = self.beyond, None
        if continuation is not None:
            self.listed = listed = continuation.listed
            hinged = hinged | listed
            self.hinged = jnp.where(hinged, 1.0, 0.0).astype(vertices.dtype)
            self.beyond = jnp.where(listed, 0.0, self.beyond)
            self.arms = jnp.where(listed[:, None], continuation.arms, self.arms)
        self.far_area_normal = cross(self.arms, triangles.edges)
        sine = -jnp.sqrt(triangles.squared_lengths) * dot(self.arms, triangles.area_normal[None])
        cosine = dot(self.far_area_normal, triangles.area_normal[None])
        # The far vertex of a boundary edge is a placeholder; both arguments are replaced before they are divided.
        self.angles = jnp.arctan2(jnp.where(hinged, sine, 0.0), jnp.where(hinged, cosine, 1.0))

    def near_part(self, values: Float[Array, "3 F"]) -> Float[Array, "3 F"]:
        """Of a quantity in proportion to the hinge angles, the part between the normals of this face and of the edge:
        half, and all of it where the normal of the edge is held."""
        return 0.5 * values if self.listed is None else jnp.where(self.listed, values, 0.5 * values)


class HingeGradients(eqx.Module):
    """What the gradients of the hinge angles are made of."""

    near: Float[Array, "3 3 F"]  # unit normal of the face over the height of corner i
    far: Float[Array, "3 3 F"]  # unit normal of the neighbour over the height of its far vertex
    near_feet: Float[Array, "3 F"]
    far_feet: Float[Array, "3 F"]

    def __init__(self, triangles: Triangles, hinges: Hinges):
        lengths = jnp.sqrt(triangles.squared_lengths)
        far_squared = dot(hinges.far_area_normal, hinges.far_area_normal)
        far_squared = jnp.where(hinges.beyond > 0, far_squared, 1.0)
        self.near = triangles.area_normal[None] * (hinges.hinged * lengths / triangles.twice_area**2)[:, None]
        self.far = hinges.far_area_normal * (hinges.beyond * lengths / far_squared)[:, None]
        self.near_feet = triangles.feet()
        self.far_feet = dot(hinges.arms, triangles.edges) / triangles.squared_lengths

    def pull_back(self, stress: Float[Array, "3 F"]) -> tuple[Float[Array, "3 3 F"], ...]:
        """Sum of `stress[i]` times the gradient of hinge angle i: at the tail and head of each edge, before and
        beyond it."""
        near, far = stress[:, None] * self.near, stress[:, None] * self.far
        head = self.near_feet[:, None] * near + self.far_feet[:, None] * far
        # The weights of a gradient sum to zero, so the tail takes what the others leave.
        return near + far - head, head, -near, -far

    def rows(self) -> tuple[Float[Array, "3 9 F"], Float[Array, "3 3 F"]]:
        """The gradient of each hinge angle in the coordinates of the three corners, and of its own far vertex."""
        # The far face of hinge i moves with its two ends, not with corner i.
        far = _OFF[:, :, None] * _weights(self.far_feet)
        corners = -_weights(self.near_feet)[:, :, None] * self.near[:, None] - far[:, :, None] * self.far[:, None]
        return corners.reshape(3, 9, -1), -self.far


_OFF = 1.0 - np.eye(3)


def _weights(feet: Float[Array, "3 F"]) -> Float[Array, "3 3 F"]:
    """Weights [i, p] of the corners in the motion of corner i against the foot of its height."""
    one = jnp.ones_like(feet[0])
    rows = [[one, feet[0] - 1.0, -feet[0]], [-feet[1], one, feet[1] - 1.0], [feet[2] - 1.0, -feet[2], one]]
    return jnp.stack([jnp.stack(row) for row in rows])


def at_corners(tails: Float[Array, "3 3 F"], heads: Float[Array, "3 3 F"]) -> list[Float[Array, "3 F"]]:
    """What tail and head of each edge carry, added up at the corners."""
    return [tails[(p + 2) % 3] + heads[(p + 1) % 3] for p in range(3)]


def length_curvature(stress: Float[Array, "3 F"]) -> Float[Array, "6 3 3 F"]:
    """Sum of `stress[i]` times the second derivative of squared length i, as blocks over `CORNER_PAIRS`."""
    shares = np.array([[2.0 * SIGN[i, p] * SIGN[i, q] for i in range(3)] for p, q in CORNER_PAIRS])[:, :, None]
    factors = stress[0] * shares[:, 0] + stress[1] * shares[:, 1] + stress[2] * shares[:, 2]
    return factors[:, None, None] * jnp.eye(3)[:, :, None]


def hinge_curvature(triangles: Triangles, stress: Float[Array, "3 F"]) -> Float[Array, "6 3 3 F"]:
    """Sum of `stress[i]` times this face's part of the second derivative of hinge angle i, as blocks over
    `CORNER_PAIRS`.

    With r the motion of corner i against its foot, e that of the edge vector, m = n x e the unit vector from the edge
    to the corner and l the edge length, the part is
    (m.r n.r' + n.r m.r') / h^2 + (e.r n.e' + n.e e.r') / (h l) + (m.e n.e' + n.e m.e') / (2 l^2),
    in which the two faces' last terms are symmetrised: their skew parts cancel. All of it is of the form v n^T + n v^T.
    """
    inverse_length = 1.0 / jnp.sqrt(triangles.squared_lengths)
    inverse_height = jnp.sqrt(triangles.squared_lengths) / triangles.twice_area
    normal = triangles.area_normal / triangles.twice_area
    along = triangles.edges * inverse_length[:, None]
    inward = cross(jnp.broadcast_to(normal, along.shape), along)
    weight = _weights(triangles.feet())
    by_height = (inverse_height**2 * stress)[:, None] * inward
    by_length = (0.5 * inverse_length**2 * stress)[:, None] * inward
    mixed = (inverse_height * inverse_length * stress)[:, None] * along

    # Taken apart once: each slice that stands in the program costs time to compile.
    weights = [list(row) for row in weight]
    by_height, by_length, mixed = list(by_height), list(by_length), list(mixed)

    def entry(p, q):
        total = sum(weights[i][p] * weights[i][q] * by_height[i] for i in range(3))
        for i in range(3):
            if i != q:
                along_edge = weights[i][p] * mixed[i]
                total = total + SIGN[i, q] * (along_edge if i == p else along_edge + SIGN[i, p] * by_length[i])
        return total

    against_normal = jnp.stack([entry(p, q) for p in range(3) for q in range(3)])
    # Kept in memory, or XLA computes it again for every block.
    against_normal, normal = jax.lax.optimization_barrier((against_normal, normal))
    return jnp.stack(
        [
            against_normal[3 * p + q][:, None] * normal + normal[:, None] * against_normal[3 * q + p]
            for p, q in CORNER_PAIRS
        ]
    )
