"""The triangle mesh: vertices, faces, the data they carry, and who is next to whom. All of it array leaves of one
Equinox module, so that a mesh passes through `jit`, `grad` and `vmap` and its vertices can be trained."""

import os
import warnings
from collections.abc import Callable, Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from .._programs.precision import require_x64
from .._programs.tracing import known
from . import files
from .connectivity import SurfaceError, connect, listed
from .formats.content import MeshTopologyWarning
from .quality import MeshQuality, doubts, measure
from .units import MILLIMETRES, millimetres


class Mesh(eqx.Module):
    """An oriented surface of triangles, closed or with boundaries, in one piece or several.

    Faces keep the order and the first corner they are given with, since an angle in a face is measured from its first
    edge. The sides of a face are numbered by the corner they lie opposite to: side 0 of face (a, b, c) is the edge
    (b, c), side 1 is (c, a), side 2 is (a, b). All integer arrays are int32, and -1 stands for "there is none".

    **Attributes:**

    - `vertices`: positions, in the caller's unit of length.
    - `faces`: vertex indices; a → b → c runs counter-clockwise seen from the side the normal points to.
    - `edges`: (tail, head) of each edge, in the direction its first face runs along it.
    - `edge_faces`: the faces of each edge, the lower index first; the second is -1 on the boundary.
    - `edge_corners`: the local corner (0, 1, 2) opposite the edge in each of those faces.
    - `face_edges`: the edge on each side of a face.
    - `twins`: for each side of a face, the same side seen from the neighbour, as `3 * neighbour + side`.
    - `face_opposite`: for each side of a face, the neighbour's corner that is not on it.
    - `vertex_data`, `face_data`: named arrays, one row per vertex or face.
    """

    vertices: Float[Array, "V 3"]
    faces: Int[Array, "F 3"]
    edges: Int[Array, "E 2"]
    edge_faces: Int[Array, "E 2"]
    edge_corners: Int[Array, "E 2"]
    face_edges: Int[Array, "F 3"]
    twins: Int[Array, "F 3"]
    face_opposite: Int[Array, "F 3"]
    vertex_data: dict[str, Array]
    face_data: dict[str, Array]

    def __init__(
        self,
        vertices: ArrayLike | Sequence,
        faces: ArrayLike | Sequence,
        vertex_data: Mapping[str, ArrayLike] | None = None,
        face_data: Mapping[str, ArrayLike] | None = None,
    ):
        """**Arguments:**

        - `vertices`: positions, shape `(V, 3)`, of any real type; kept in float64. May be traced, and is then not
            checked for values.
        - `faces`: vertex indices from 0, shape `(F, 3)`, of any integer type. Not traced: connectivity is computed on
            the host, in numpy.
        - `vertex_data`, `face_data`: named arrays, one row per vertex or face.

        **Raises:** `RuntimeError` unless JAX is in double precision. `ValueError`, naming the place and the remedy, for
        arrays of a wrong shape or type, a coordinate that is not finite, and whatever is no oriented surface: an index
        out of range, a repeated corner or face, an edge of more than two faces, faces of opposite orientation, an
        unused vertex, a vertex where the surface touches itself, a face without area.
        """
        require_x64("a Mesh")
        corners = _host_faces(faces)
        points = _positions(vertices)
        connectivity = connect(corners, points.shape[0])
        if isinstance(points, np.ndarray):
            _check_areas(points, corners)
        self.vertices = known(points) if isinstance(points, np.ndarray) else points
        self.faces = known(corners.astype(np.int32))
        self.edges = known(connectivity.edges)
        self.edge_faces = known(connectivity.edge_faces)
        self.edge_corners = known(connectivity.edge_corners)
        self.face_edges = known(connectivity.face_edges)
        self.twins = known(connectivity.twins)
        self.face_opposite = known(connectivity.face_opposite)
        self.vertex_data = _data(vertex_data, "vertex", points.shape[0])
        self.face_data = _data(face_data, "face", len(corners))

    @staticmethod
    def read(
        path: str | os.PathLike,
        *,
        weld: float | int | bool | None = None,
        split: bool = False,
        drop_unused: bool = False,
        orient: bool = False,
        unit: str | None = None,
    ) -> "Mesh":
        """Reads a mesh from a file, with its vertex and face data.

        Vertices, faces and first corners come in the order of the file. Of an obj file, positions and faces are read:
        seams of its texture do not tear the surface.

        **Arguments:**

        - `path`: a file in one of the formats obj, ply, stl, off, vtk, vtp, vtu, msh, told by its extension.
        - `weld`: vertices up to so far apart become one, in the unit of the file. `True` joins equal ones, and those at
            open edges within 1e-4 of the diagonal of the surface and a tenth of the shortest edge there: noise, but
            no gaps that are meant; `False` joins none, 0 equal ones. By default `True` for stl, whose triangles are not
            connected, else `False`. Where vertices are joined, faces that are left without area or given twice go.
        - `split`: cuts faces of more than three corners into triangles, so that the smallest angle is as large as can
            be. Their data go to each part; angles of directors lose their meaning, as first edges change.
        - `drop_unused`: leaves out vertices that no face has.
        - `orient`: reverses the faces, of each piece the fewer ones, whose orientation differs from the others'.
        - `unit`: of the file, `"mm"`, `"cm"`, `"m"`, `"um"` or `"in"`: positions are turned into metres, data are
            not. By default they stay as they are.

        **Raises:** `MeshFileError`, a `ValueError` that names the path, for a missing file (it is a `FileNotFoundError`
        then too), an unknown format, a file that cannot be understood, faces that are no triangles (with their count),
        points without faces, and a mesh that `Mesh` refuses, with what helps for a file. `ValueError` for a tolerance
        or a unit that is none.
        **Warns:** [`shellkit.MeshTopologyWarning`][] where vertices coincide, where there are several pieces or
        several boundary loops, and where faces were left out.
        """
        content, remarks = files.read(path, files.Choices(weld, split, drop_unused, orient, unit))
        try:
            mesh = Mesh(content.vertices, content.faces, content.vertex_data, content.face_data)
        except ValueError as error:
            reason = error.of_file if isinstance(error, SurfaceError) else error
            raise files.MeshFileError(f"{os.fspath(path)}: {reason}") from error
        remarks += doubts(content.vertices, mesh.quality(), content.faces)
        if remarks:
            warnings.warn(f"{os.fspath(path)}: {'; '.join(remarks)}.", MeshTopologyWarning, stacklevel=2)
        return mesh

    def write(
        self,
        path: str | os.PathLike,
        vertex_data: Mapping[str, ArrayLike] | None = None,
        face_data: Mapping[str, ArrayLike] | None = None,
        *,
        unit: str | None = None,
    ) -> None:
        """Writes the mesh and its data to a file, whole or not at all.

        Positions are written exactly in every format. vtu, vtp and vtk keep data of every shape and type; ply keeps
        numbers and vectors, but no 64-bit integers beyond the 32-bit range; msh keeps numbers, vectors of three and
        3 x 3 tensors, as float64; obj, off and stl keep none.

        **Arguments:**

        - `path`: where to; the extension tells the format, as in `read`.
        - `vertex_data`, `face_data`: further named arrays, in the place of the mesh's own of the same name.
        - `unit`: of the file, for a mesh in metres: `"mm"`, `"cm"`, `"m"`, `"um"` or `"in"`, as in `read`. By default
            positions are written as they are.

        **Raises:** `MeshFileError` for an unknown format or a missing folder, `ValueError` for data of another length
        and for a unit that is none.
        **Warns:** `MeshDataWarning` with the names of the data that the format cannot keep.
        """
        scale = 1.0 if unit is None else MILLIMETRES["m"] / millimetres("Mesh.write", unit)
        files.write(
            path,
            files.Content(
                np.asarray(self.vertices) * scale,
                np.asarray(self.faces),
                _host({**self.vertex_data, **_data(vertex_data, "vertex", self.n_vertices)}),
                _host({**self.face_data, **_data(face_data, "face", self.n_faces)}),
            ),
        )

    @property
    def n_vertices(self) -> int:
        """The number of vertices."""
        return self.vertices.shape[0]

    @property
    def n_edges(self) -> int:
        """The number of edges, those on the boundary included."""
        return self.edges.shape[0]

    @property
    def n_faces(self) -> int:
        """The number of faces."""
        return self.faces.shape[0]

    @property
    def is_closed(self) -> bool:
        """Whether the surface has no boundary: every edge then takes up two of the `3 * n_faces` sides."""
        return 2 * self.n_edges == 3 * self.n_faces

    @property
    def boundary_edges(self) -> Bool[Array, " E"]:
        """Which edges have one face only."""
        return self.edge_faces[:, 1] < 0

    @property
    def boundary_vertices(self) -> Bool[Array, " V"]:
        """Which vertices lie on a boundary edge."""
        ends = jnp.broadcast_to(self.boundary_edges[:, None], self.edges.shape)
        return jnp.zeros(self.n_vertices, bool).at[self.edges].max(ends)

    def boundary_loops(self) -> list[Int[np.ndarray, " n"]]:
        """The closed loops of the boundary, each as its vertices in order, with the surface to the left.

        Computed on the host; not to be called inside `jit`.
        """
        following = {int(tail): int(head) for tail, head in np.asarray(self.edges)[np.asarray(self.boundary_edges)]}
        loops = []
        while following:
            loop = [next(iter(following))]
            while (head := following.pop(loop[-1])) != loop[0]:
                loop.append(head)
            loops.append(np.array(loop, np.int32))
        return loops

    def with_vertices(self, vertices: ArrayLike) -> "Mesh":
        """The same mesh with its vertices elsewhere; connectivity and data are shared, not computed anew.

        **Arguments:**

        - `vertices`: positions, shape `(V, 3)`; may be traced.

        **Raises:** `ValueError` for another shape and for a coordinate that is not finite.
        """
        points = _positions(vertices)
        if points.shape != self.vertices.shape:
            raise ValueError(
                f"the new vertices have shape {points.shape}, but the mesh has {self.n_vertices} vertices: expected "
                f"{self.vertices.shape}."
            )
        return eqx.tree_at(lambda mesh: mesh.vertices, self, jnp.asarray(points))

    def flipped(self) -> "Mesh":
        """The same surface with its normals on the other side, and the same data.

        Face (a, b, c) becomes (b, a, c): its first edge stays where it is, so that a director at the angle θ from it is
        now at the angle -θ.
        """
        return Mesh(self.vertices, _host_faces(self.faces)[:, [1, 0, 2]], self.vertex_data, self.face_data)

    def refine(self, project: Callable[[Float[Array, "n 3"]], ArrayLike] | None = None) -> "Mesh":
        """Splits every face into four at the midpoints of its edges; the surface stays the same set of points, unless
        the new vertices are moved onto another one.

        Face `f` becomes the faces `4 * f + k`: one at each corner, then the middle one. Each has its first edge
        parallel to that of `f`, so that face data repeated four times over keep their meaning, angles of directors
        included (in the middle face the edge runs the other way). Vertices keep their index, and `V + e` is the
        midpoint of edge `e`. Vertex data of floating type are interpolated; of whole numbers and flags a midpoint takes
        the lower of its edge's ends, so that a flag is set where both are. `prolong` does the same for one more field.

        **Arguments:**

        - `project`: a function from the midpoints, shape `(n, 3)`, to where they should be, as onto a unit sphere:
            `lambda p: p / jnp.linalg.norm(p, axis=1, keepdims=True)`.
        """
        a, b, c = _host_faces(self.faces).T
        bc, ca, ab = (self.n_vertices + np.asarray(self.face_edges)).T
        children = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, bc, ca, ab], axis=1).reshape(-1, 3)
        points = self.prolong(self.vertices)
        if project is not None:
            points = jnp.concatenate([points[: self.n_vertices], jnp.asarray(project(points[self.n_vertices :]))])
        return Mesh(
            points,
            children,
            {name: self.prolong(values) for name, values in self.vertex_data.items()},
            {name: jnp.repeat(values, 4, axis=0) for name, values in self.face_data.items()},
        )

    def prolong(self, values: ArrayLike) -> Array:
        """A field on the vertices of this mesh as one on those of `refine()`.

        **Arguments:**

        - `values`: one row per vertex, shape `(V, ...)`, such as the positions of an equilibrium.

        **Returns:** an array of shape `(V + E, ...)`: the values themselves, then those at the midpoints of the edges,
        the mean of both ends for floating types, the lower of both for whole numbers and flags.

        **Raises:** `ValueError` for another number of rows.
        """
        xp = jnp if isinstance(values, Tracer) else np  # numpy has nothing to compile
        values = xp.asarray(values)
        if values.ndim < 1 or values.shape[0] != self.n_vertices:
            raise ValueError(
                f"the field has shape {values.shape}; expected ({self.n_vertices}, ...), one row per vertex."
            )
        tails, heads = np.asarray(self.edges).T
        middle = xp.minimum(values[tails], values[heads])
        if jnp.issubdtype(values.dtype, jnp.inexact):
            middle = (values[tails] + values[heads]) / 2
        return jnp.asarray(xp.concatenate([values, middle]))

    def quality(self) -> MeshQuality:
        """Measures the mesh, on the host: angles, areas, aspect ratios, topology, orientation. Print the result."""
        return measure(*(np.asarray(a) for a in (self.vertices, self.faces, self.edges, self.edge_faces)))


def _host_faces(faces):
    if isinstance(faces, Tracer):
        raise ValueError(
            "faces is traced, but connectivity is computed on the host: build the mesh outside jit, grad and vmap, and "
            "move its vertices inside with mesh.with_vertices(...)."
        )
    faces = np.asarray(faces)
    if faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
        raise ValueError(f"faces has shape {faces.shape}; expected (F, 3) with at least one face, each a triangle.")
    if not np.issubdtype(faces.dtype, np.integer):
        raise ValueError(f"faces has type {faces.dtype}; expected vertex indices, of an integer type.")
    return faces.astype(np.int64)


def _positions(vertices):
    """In float64: a numpy array where the values are known, else a traced one."""
    if not isinstance(vertices, Tracer):
        vertices = np.asarray(vertices)
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise ValueError(f"vertices has shape {vertices.shape}; expected (V, 3): for a flat mesh, add a column z = 0.")
    if not (np.issubdtype(vertices.dtype, np.floating) or np.issubdtype(vertices.dtype, np.integer)):
        raise ValueError(f"vertices has type {vertices.dtype}; expected real numbers.")
    vertices = vertices.astype(np.float64)
    if isinstance(vertices, np.ndarray) and not np.isfinite(vertices).all():
        bad = np.flatnonzero(~np.isfinite(vertices).all(1))
        raise ValueError(
            f"not a finite number: vertex {bad[0]} is at {vertices[bad[0]].tolist()} (such vertices: {listed(bad)}). "
            "Remove them or put their positions right."
        )
    return vertices


def _check_areas(points, faces):
    a, b, c = points[faces[:, 0]], points[faces[:, 1]], points[faces[:, 2]]
    u, v = b - a, c - a
    longest = np.maximum(np.maximum((u * u).sum(1), (v * v).sum(1)), ((v - u) ** 2).sum(1))
    # A needle is allowed; what rounding cannot tell from a straight line is not.
    flat = np.flatnonzero(np.linalg.norm(np.cross(u, v), axis=1) <= 4 * np.finfo(float).eps * longest)
    if len(flat):
        raise SurfaceError(
            f"a face without area: the corners {faces[flat[0]].tolist()} of face {flat[0]} lie on one line or coincide "
            f"(such faces: {listed(flat)}).",
            remedy="Delete these faces, merge coincident vertices, or move a corner.",
            in_file="Mesh.read(path, weld=True) leaves them out where corners coincide; where they lie on one line, "
            "mesh the surface anew in the program that the file comes from.",
        )


def _data(data, of, n):
    arrays = {}
    for name, values in (data or {}).items():
        array = values
        if not isinstance(values, jax.Array):
            array = np.asarray(values)
            array = array.astype(array.dtype.newbyteorder("="))  # vtk files are big-endian, which JAX rejects
        if array.ndim < 1 or array.shape[0] != n:
            raise ValueError(
                f"{of}_data[{name!r}] has shape {array.shape}; expected ({n}, ...), one row a {of} of the mesh."
            )
        arrays[str(name)] = jnp.asarray(array)
    return arrays


def _host(data):
    return {name: np.asarray(values) for name, values in data.items()}
