"""VTK's own formats, through pyvista: vtk and vtp hold surfaces, vtu unstructured grids. They keep data of every type;
the shape of a row of more than one dimension (a tensor a face) is kept beside it, in a field named after the data."""

from pathlib import Path

import numpy as np

from .content import Content, refuse_polygons


_SHAPE = "shape of {} data {}"
_POINTLIKE, _TRIANGLE = (1, 2, 3, 4), 5  # VTK's numbers for vertices and lines, which are passed over, and triangles


def read(path: Path) -> Content:
    import pyvista

    grid = pyvista.read(path)
    if isinstance(grid, pyvista.PolyData):
        faces, chosen = _polygons(grid)
    elif isinstance(grid, pyvista.UnstructuredGrid):
        faces, chosen = _cells(grid)
    else:
        raise ValueError(f"it holds a {type(grid).__name__}, and a surface was expected (PolyData, UnstructuredGrid).")
    if not len(faces):
        raise ValueError("it holds no triangles.")
    vertex_data = {name: _shaped(grid, "vertex", name, np.asarray(grid.point_data[name])) for name in grid.point_data}
    face_data = {name: _shaped(grid, "face", name, np.asarray(grid.cell_data[name])[chosen]) for name in grid.cell_data}
    return Content(np.asarray(grid.points, float), faces, vertex_data, face_data)


def _polygons(surface):
    if surface.n_strips:
        raise ValueError(f"it holds {surface.n_strips} triangle strips. Write it anew after pyvista's triangulate().")
    offsets = np.asarray(surface.GetPolys().GetOffsetsArray(), int) if surface.n_faces else np.zeros(1, int)
    sizes = np.diff(offsets)
    refuse_polygons(int((sizes != 3).sum()), len(sizes))
    # Cells are numbered vertices first, then lines, then polygons.
    chosen = surface.n_verts + surface.n_lines + np.arange(len(sizes))
    return surface.faces.reshape(-1, 4)[:, 1:].astype(int), chosen


def _cells(grid):
    kinds = np.asarray(grid.celltypes)
    surface = ~np.isin(kinds, _POINTLIKE)
    chosen = np.flatnonzero(kinds == _TRIANGLE)
    refuse_polygons(int(surface.sum()) - len(chosen), int(surface.sum()))
    starts = np.asarray(grid.cell_offsets, int)[:-1][chosen]
    return np.asarray(grid.cell_connectivity, int)[starts[:, None] + np.arange(3)], chosen


def _shaped(grid, of, name, values):
    key = _SHAPE.format(of, name)
    return values.reshape(len(values), *grid.field_data[key]) if key in grid.field_data else values


def write(path: Path, content: Content) -> list[str]:
    import pyvista

    if path.suffix.lower() == ".vtu":
        grid = pyvista.UnstructuredGrid({_TRIANGLE: content.faces}, content.vertices)
    else:
        grid = pyvista.PolyData.from_regular_faces(content.vertices, content.faces)
    dropped = []
    for of, data, attributes in (
        ("vertex", content.vertex_data, grid.point_data),
        ("face", content.face_data, grid.cell_data),
    ):
        for name, values in data.items():
            if values.dtype.kind not in "biufc" or values.dtype == np.float16:
                dropped.append(f"{of} data {name!r} of type {values.dtype}")
                continue
            attributes[name] = values.reshape(len(values), -1) if values.ndim > 1 else values
            if values.ndim > 2 or values.shape[1:] == (1,):
                grid.field_data[_SHAPE.format(of, name)] = np.array(values.shape[1:])
    grid.save(path)
    return dropped
