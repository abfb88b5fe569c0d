"""How a triangulated surface bends: dihedral angles at the edges, mean and Gauss curvature at the vertices. Curvature
is positive where the surface is convex seen from the side its normals point to: an outward unit sphere has mean
curvature +1. Compiled as wholes: called one by one, their many small operations would take seconds at first."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._mesh.mesh import Mesh
from .rowwise import angle, dot, over, unit
from .surface import corners_to_vertices, edge_lengths, face_areas, face_normals


@jax.jit
def dihedral_angles(vertices: Float[Array, "V 3"], mesh: Mesh) -> Float[Array, " E"]:
    r"""Angle between the normals of the two faces of each edge, positive where the edge is convex.

    $\theta = \operatorname{atan2}(\hat e \cdot (n \times n'),\, n \cdot n')$, with $\hat e$ along the edge as its
    first face runs. It is smooth up to $\pm\pi$, where a folded edge jumps from one to the other; values and
    derivatives are finite everywhere.

    **Arguments:**

    - `vertices`: positions of the mesh's vertices, shape `(V, 3)`; need not be `mesh.vertices`.
    - `mesh`: the connectivity.

    **Returns:**

    An array of shape `(E,)`, radians in $[-\pi, \pi]$; zero on the boundary and at a face of zero area.
    """
    normals = face_normals(vertices, mesh)
    first, second = mesh.edge_faces[:, 0], mesh.edge_faces[:, 1]
    n, other = normals[first], normals[second]
    along = unit(vertices[mesh.edges[:, 1]] - vertices[mesh.edges[:, 0]])
    turn = angle(dot(along, jnp.cross(n, other)), dot(n, other))
    return jnp.where(second >= 0, turn, 0.0)


@jax.jit
def voronoi_areas(vertices: Float[Array, "V 3"], mesh: Mesh) -> Float[Array, " V"]:
    r"""Area of the surface nearest to each vertex, the right one to divide a vertex's curvature by. They sum to the
    whole.

    The mixed areas of Meyer, Desbrun, Schröder and Barr (2003), section 3.3: Voronoi cells within a face, but half of
    an obtuse face for its obtuse corner and a quarter for either other. Continuous; the derivative jumps where a
    corner passes 90°. On irregular meshes of a sphere they bring curvature about five times as close as barycentric
    areas ([`shellkit.vertex_areas`][]), which are smooth.

    **Arguments:**

    - `vertices`: positions of the mesh's vertices, shape `(V, 3)`; need not be `mesh.vertices`.
    - `mesh`: the connectivity.

    **Returns:**

    An array of shape `(V,)`, in the square of the vertices' unit.

    ??? cite

        ```bibtex
        @incollection{meyer2003discrete,
            author = {Meyer, Mark and Desbrun, Mathieu and Schr{\"o}der, Peter and Barr, Alan H.},
            title = {Discrete differential-geometry operators for triangulated 2-manifolds},
            booktitle = {Visualization and Mathematics III},
            year = {2003},
        }
        ```
    """
    cosines, sines = _corners(vertices, mesh)
    corners = vertices[mesh.faces]
    opposite = jnp.roll(corners, 1, axis=1) - jnp.roll(corners, -1, axis=1)
    parts = dot(opposite, opposite) * over(cosines, sines)
    voronoi = (jnp.sum(parts, axis=1, keepdims=True) - parts) / 8
    obtuse = cosines < 0
    shared = jnp.where(obtuse, 0.25 * sines, 0.125 * sines)
    cells = jnp.where(jnp.any(obtuse, axis=1, keepdims=True), shared, voronoi)
    return corners_to_vertices(cells, vertices, mesh)


@jax.jit
def mean_curvature(vertices: Float[Array, "V 3"], mesh: Mesh) -> Float[Array, " V"]:
    r"""Mean curvature $H = (\kappa_1 + \kappa_2) / 2$ of each vertex, from the dihedral angles of the edges around it.

    $H_i = \frac{1}{4 A_i} \sum_{e \ni i} \theta_e \ell_e$: the mean curvature measure of Cohen-Steiner and Morvan
    (2003), half of each edge's going to either end, over the areas of `voronoi_areas`.

    At a boundary vertex it lacks what lies beyond the boundary: do not read it there. Single values converge on regular
    triangulations only; on others, average them over a patch.

    **Arguments:**

    - `vertices`: positions of the mesh's vertices, shape `(V, 3)`; need not be `mesh.vertices`.
    - `mesh`: the connectivity.

    **Returns:**

    An array of shape `(V,)`, in the inverse of the vertices' unit. A vertex without area has curvature zero.

    ??? cite

        ```bibtex
        @inproceedings{cohensteiner2003restricted,
            author = {Cohen-Steiner, David and Morvan, Jean-Marie},
            title = {Restricted {D}elaunay triangulations and normal cycle},
            booktitle = {Proceedings of the 19th Symposium on Computational Geometry},
            year = {2003},
        }
        ```
    """
    bend = dihedral_angles(vertices, mesh) * edge_lengths(vertices, mesh)
    ends = jnp.broadcast_to(bend[:, None], mesh.edges.shape)
    total = jax.ops.segment_sum(ends.ravel(), mesh.edges.ravel(), num_segments=vertices.shape[0])
    return over(total, 4 * voronoi_areas(vertices, mesh))


@jax.jit
def angle_defects(vertices: Float[Array, "V 3"], mesh: Mesh) -> Float[Array, " V"]:
    r"""What the angles of the faces around each vertex lack of a full turn, or of half a turn on the boundary.

    They sum to $2\pi\chi$, with $\chi$ the Euler characteristic (Gauss-Bonnet; Meyer, Desbrun, Schröder and Barr, 2003,
    section 4): inside, a defect is the integral of the Gauss curvature over the vertex's cell; on the boundary, mostly
    that of the boundary's geodesic curvature.

    **Arguments:**

    - `vertices`: positions of the mesh's vertices, shape `(V, 3)`; need not be `mesh.vertices`.
    - `mesh`: the connectivity.

    **Returns:**

    An array of shape `(V,)`, radians.
    """
    cosines, sines = _corners(vertices, mesh)
    full = jnp.where(mesh.boundary_vertices, jnp.pi, 2 * jnp.pi)
    return full - corners_to_vertices(angle(sines, cosines), vertices, mesh)


@jax.jit
def gauss_curvature(vertices: Float[Array, "V 3"], mesh: Mesh) -> Float[Array, " V"]:
    r"""Gauss curvature $K = \kappa_1 \kappa_2$ of each vertex: its angle defect over its area.

    Meyer, Desbrun, Schröder and Barr (2003), section 4, with the areas of `voronoi_areas`. Single values
    converge on regular triangulations only; on others, average them over a patch.

    **Arguments:**

    - `vertices`: positions of the mesh's vertices, shape `(V, 3)`; need not be `mesh.vertices`.
    - `mesh`: the connectivity.

    **Returns:**

    An array of shape `(V,)`, in the inverse square of the vertices' unit. Zero on the boundary, where an angle defect
    says nothing about it (see `angle_defects`), and at a vertex without area.
    """
    defects = jnp.where(mesh.boundary_vertices, 0.0, angle_defects(vertices, mesh))
    return over(defects, voronoi_areas(vertices, mesh))


def _corners(vertices: Float[Array, "V 3"], mesh: Mesh) -> tuple[Float[Array, "F 3"], Float[Array, "F 3"]]:
    """Cosine and sine of the angle at each corner of each face, both times the product of the sides that meet there."""
    corners = vertices[mesh.faces]
    ahead, behind = jnp.roll(corners, -1, axis=1) - corners, jnp.roll(corners, 1, axis=1) - corners
    cosines = dot(ahead, behind)
    return cosines, jnp.broadcast_to(2 * face_areas(vertices, mesh)[:, None], cosines.shape)
