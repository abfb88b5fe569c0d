"""What a mesh is like: the shape of its triangles and the topology of its surface, in numbers and as a text."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from .connectivity import components, listed
from .welding import coincident


@dataclass(frozen=True, eq=False)
class MeshQuality:
    """The report of `Mesh.quality()`. Arrays are numpy's, angles are in degrees, the rest in the mesh's own units.

    **Attributes:**

    - `angles`: the angle at each corner of each face.
    - `areas`: of each face.
    - `aspect_ratios`: longest side over the inscribed circle's radius, scaled to one for an equilateral triangle.
    - `edge_lengths`: of each edge.
    - `degenerate_faces`: indices of faces whose area rounding cannot tell from zero; `Mesh` refuses them, but vertices
        moved later can make them.
    - `n_vertices`, `n_edges`, `n_faces`, `n_components`, `n_boundary_loops`: counts.
    - `volume`: enclosed, positive where the normals point outward; None for an open surface.
    """

    angles: Float[np.ndarray, "F 3"]
    areas: Float[np.ndarray, " F"]
    aspect_ratios: Float[np.ndarray, " F"]
    edge_lengths: Float[np.ndarray, " E"]
    degenerate_faces: Int[np.ndarray, " n"]
    n_vertices: int
    n_edges: int
    n_faces: int
    n_components: int
    n_boundary_loops: int
    volume: float | None

    @property
    def min_angle(self) -> float:
        """The smallest angle of any triangle, in degrees."""
        return float(self.angles.min())

    @property
    def max_angle(self) -> float:
        """The largest angle of any triangle, in degrees."""
        return float(self.angles.max())

    @property
    def area(self) -> float:
        """The area of the whole surface."""
        return float(self.areas.sum())

    @property
    def is_closed(self) -> bool:
        """Whether there is no boundary."""
        return self.n_boundary_loops == 0

    @property
    def is_outward(self) -> bool | None:
        """Whether the normals of a closed surface point out of it; None for an open one, where it has no meaning."""
        return None if self.volume is None else self.volume > 0

    @property
    def euler_characteristic(self) -> int:
        """Vertices - edges + faces: two for a sphere, one for a disc, zero for a torus, a cylinder, an annulus."""
        return self.n_vertices - self.n_edges + self.n_faces

    @property
    def genus(self) -> int:
        """The number of handles, summed over the components: none for a sphere or a disc, one for a torus."""
        return (2 * self.n_components - self.n_boundary_loops - self.euler_characteristic) // 2

    def __str__(self) -> str:
        lengths, areas = self.edge_lengths, self.areas
        worst = np.unravel_index(np.argmin(self.angles), self.angles.shape)[0]
        side = {None: "", True: ", normals outward", False: ", normals INWARD: use mesh.flipped()"}[self.is_outward]
        loops = "closed" if self.is_closed else f"open, {self.n_boundary_loops} boundary loop(s)"
        lines = [
            f"{self.n_vertices} vertices, {self.n_edges} edges, {self.n_faces} faces",
            f"topology      {self.n_components} component(s), {loops}, genus {self.genus}, "
            f"Euler characteristic {self.euler_characteristic}",
            f"orientation   consistent{side}",
            f"angles        {self.min_angle:.2f} (face {worst}) to {self.max_angle:.2f} degrees",
            f"aspect ratio  {self.aspect_ratios.mean():.3f} mean, {self.aspect_ratios.max():.3f} largest",
            f"edge lengths  {lengths.min():.6g} to {lengths.max():.6g}, mean {lengths.mean():.6g}, "
            f"deviation {lengths.std():.3g}",
            f"areas         {areas.min():.6g} to {areas.max():.6g}, total {self.area:.9g}",
        ]
        if self.volume is not None:
            lines.append(f"volume        {self.volume:.9g}")
        degenerate = listed(self.degenerate_faces) if len(self.degenerate_faces) else "none"
        return "\n".join([*lines, f"degenerate    {degenerate}"])


def measure(
    vertices: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    edges: Int[np.ndarray, "E 2"],
    edge_faces: Int[np.ndarray, "E 2"],
) -> MeshQuality:
    """Measures a mesh, given by the arrays of `Mesh`; see `MeshQuality`."""
    corners = vertices[faces]
    sides = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)  # side i lies opposite corner i
    lengths = np.linalg.norm(sides, axis=2)
    double_areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    longest = lengths.max(1)
    dots = -(np.roll(sides, -1, axis=1) * np.roll(sides, -2, axis=1)).sum(2)
    with np.errstate(divide="ignore", invalid="ignore"):
        aspect = longest * lengths.sum(1) / (2 * np.sqrt(3) * double_areas)

    inner = edge_faces[:, 1] >= 0
    loops = 0
    if not inner.all():
        ends, at = np.unique(edges[~inner], return_inverse=True)
        loops = components(len(ends), *at.reshape(-1, 2).T)[0]
    # Measured from the middle, since the volume of a closed surface far from the origin loses digits.
    a, b, c = np.moveaxis(corners - vertices.mean(0), 1, 0)
    return MeshQuality(
        angles=np.degrees(np.arctan2(double_areas[:, None], dots)),
        areas=double_areas / 2,
        aspect_ratios=np.where(double_areas > 0, aspect, np.inf),
        edge_lengths=np.linalg.norm(vertices[edges[:, 1]] - vertices[edges[:, 0]], axis=1),
        degenerate_faces=np.flatnonzero(double_areas <= 4 * np.finfo(float).eps * longest**2),
        n_vertices=len(vertices),
        n_edges=len(edges),
        n_faces=len(faces),
        n_components=components(len(faces), *edge_faces[inner].T)[0],
        n_boundary_loops=loops,
        volume=float((a * np.cross(b, c)).sum() / 6) if inner.all() else None,
    )


def doubts(vertices: Float[np.ndarray, "V 3"], report: MeshQuality, faces: Int[np.ndarray, "F 3"]) -> list[str]:
    """What makes one ask whether a surface from a file is the one that was meant, in words; mostly nothing."""
    found = []
    double = coincident(vertices, faces)
    if double:
        found.append(
            f"{double} vertices lie where another one does: torn seams, or parts that touch (Mesh.read(path, weld="
            "True) joins them, weld=tolerance those that are further apart)"
        )
    if report.n_components > 1:
        found.append(
            f"the surface is in {report.n_components} pieces (Mesh.read(path, weld=tolerance) joins what is so near)"
        )
    if report.n_boundary_loops > 1:
        found.append(f"it has {report.n_boundary_loops} boundary loops (holes, open ends or tears)")
    return found
