"""How far apart two surfaces are, as a report: the largest distance, the mean, and both beside the target's size."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import ArrayLike

from .._geometry.closest import host_closest, search_faces
from .._mesh.mesh import Mesh


_SAMPLES = 20_000


@dataclass(frozen=True)
class Hausdorff:
    """The distances between a surface and a target, both ways; made by [`shellkit.hausdorff`][]. Print it.

    Lengths are in the unit of the vertices, unless said.

    **Attributes:**

    - `to_target`: the largest distance of a point of the surface from the target.
    - `from_target`: the largest distance of a point of the target from the surface.
    - `mean_to_target`, `mean_from_target`: the mean distances, over the area of the first surface.
    - `spacing`: no point of either surface is further than this from one that was measured, so that the largest
        distances are right up to it: too small by at most this much.
    - `diagonal`: that of the target's bounding box.
    """

    to_target: float
    from_target: float
    mean_to_target: float
    mean_from_target: float
    spacing: float
    diagonal: float

    @property
    def distance(self) -> float:
        """The Hausdorff distance: the larger of `to_target` and `from_target`."""
        return max(self.to_target, self.from_target)

    @property
    def mean(self) -> float:
        """The mean distance, both ways: half the sum of `mean_to_target` and `mean_from_target`."""
        return (self.mean_to_target + self.mean_from_target) / 2

    @property
    def relative_distance(self) -> float:
        """The Hausdorff distance as a fraction of the diagonal of the target's bounding box."""
        return self.distance / self.diagonal

    @property
    def relative_mean(self) -> float:
        """The mean distance as a fraction of the diagonal of the target's bounding box."""
        return self.mean / self.diagonal

    def __str__(self) -> str:
        rows = (
            ("largest distance to the target", self.to_target),
            ("largest distance from the target", self.from_target),
            ("mean distance to the target", self.mean_to_target),
            ("mean distance from the target", self.mean_from_target),
            ("Hausdorff distance", self.distance),
            ("mean distance, both ways", self.mean),
        )
        lines = [f"{name:<34}{value:>10.4g}{100 * value / self.diagonal:>9.3f} %" for name, value in rows]
        return "\n".join([f"{'':<34}{'length':>10}{'of the diagonal':>17}", *lines])


def hausdorff(vertices: ArrayLike, mesh: Mesh, target: Mesh, samples: int = _SAMPLES) -> Hausdorff:
    """Measures how far a surface and a target of any connectivity are apart, as they lie.

    Each surface is sampled evenly in every face, and each sample measured to the nearest point of the other surface,
    exactly. A report, computed on the host: for a loss with a gradient see [`shellkit.PointToSurface`][].

    **Arguments:**

    - `vertices`: positions of the vertices of `mesh`, shape `(V, 3)`, such as those of an equilibrium. Align them
        first, as by `ICP(target.faces)(vertices, target.vertices)`: nothing is moved here.
    - `mesh`: the connectivity.
    - `target`: the other surface.
    - `samples`: about how many points to measure on each, at least one in each part of a face.

    **Returns:** a [`shellkit.Hausdorff`][].

    **Raises:** `ValueError` for vertices that do not fit the mesh or are not finite.
    """
    points = np.asarray(vertices, float)
    if points.shape != (mesh.n_vertices, 3):
        raise ValueError(
            f"hausdorff: vertices has shape {points.shape}; give a position for each vertex of the mesh, shape "
            f"({mesh.n_vertices}, 3)."
        )
    if not np.isfinite(points).all():
        raise ValueError("hausdorff: the vertices are not all finite; a relaxation that failed cannot be measured.")
    here = (points, np.asarray(mesh.faces))
    there = (np.asarray(target.vertices), np.asarray(target.faces))
    largest, mean, gap = _measure(here, there, samples)
    largest_back, mean_back, gap_back = _measure(there, here, samples)
    diagonal = float(np.linalg.norm(np.ptp(there[0], axis=0)))
    return Hausdorff(largest, largest_back, mean, mean_back, max(gap, gap_back), diagonal)


def _measure(surface, other, samples):
    """The largest and the mean distance of one surface from another, and how far apart the samples lie."""
    vertices, faces = surface
    corners = vertices[faces]
    # Each face is cut into n x n equal triangles: their centroids carry the mean, and their corners the largest.
    n = max(1, round(np.sqrt(samples / len(faces))))
    i, j = (k.ravel() for k in np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij"))
    up = np.stack([i, j], axis=1)[i + j < n] + 1 / 3
    down = np.stack([i, j], axis=1)[i + j < n - 1] + 2 / 3
    lattice = np.stack([i, j], axis=1)[i + j <= n]

    def distances(places):
        weights = np.column_stack([n - places.sum(axis=1), places]) / n
        points = np.einsum("pk,fkx->fpx", weights, corners).reshape(-1, 3)
        nearest = search_faces(points, *other)
        squared = host_closest(points, other[0][other[1][nearest]])[1]
        return np.sqrt(squared).reshape(len(faces), -1)

    at_centres = distances(np.concatenate([up, down]))
    at_corners = distances(lattice.astype(float))
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = np.linalg.norm(np.cross(u, v), axis=1)
    longest = np.sqrt(max((e * e).sum(axis=1).max() for e in (u, v, v - u)))
    mean = np.average(at_centres.mean(axis=1), weights=areas)
    # No point of a triangle is further from all its corners than the longest side by the square root of three.
    return float(max(at_centres.max(), at_corners.max())), float(mean), float(longest / n / np.sqrt(3))
