"""Evening out the vertices of a triangulation."""

import numpy as np
from jaxtyping import Float, Int


ROUNDS, MOVES = 3, 10  # triangulations, and moves between two of them


def pushed_apart(points: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> Float[np.ndarray, "V 3"]:
    """Moves every vertex as if the edges were springs under pressure, all of one natural length, a fifth above their
    mean: such springs settle at nearly equal lengths (P.-O. Persson and G. Strang, SIAM Review 46, 2004, section 2, who
    take the same steps). Thirty such moves settle a mesh whose vertices start evenly spread.

    **Arguments:**

    - `points`, `faces`: the triangulation.
    """
    tails, heads = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    along = points[heads] - points[tails]
    length = np.linalg.norm(along, axis=1)
    natural = 1.2 * np.sqrt((length**2).mean())
    push = along * (np.maximum(natural - length, 0) / length)[:, None]
    # An inner edge is met once in each direction, so that pushing heads away alone moves both of its ends.
    force = np.stack([np.bincount(heads, push[:, x], len(points)) for x in range(3)], axis=1)
    return points + 0.2 * force
