"""VTK's own formats, through pyvista: vtk and vtp hold surfaces, vtu unstructured grids. They keep data of every type;
the shape of a row of more than one dimension (a tensor a face) is kept beside it, in a field named after the data."""

from pathlib import Path

import numpy as np

from .content import Content, Polygons, listed_faces, strip_triangles


_SHAPE = "shape of {} data {}"
# VTK's numbers for vertices and lines, which are passed over, and for what is flat.
_POINTLIKE, _TRIANGLE, _STRIP, _PIXEL = (1, 2, 3, 4), 5, 6, 8
_POLYGONS = (_TRIANGLE, 7, 9)


def read(path: Path) -> Polygons:
    import pyvista

    grid = pyvista.read(path)
    if isinstance(grid, pyvista.PolyData):
        rows, chosen = _polygons(grid)
    elif isinstance(grid, pyvista.UnstructuredGrid):
        rows, chosen = _cells(grid)
    else:
        raise ValueError(
            f"it holds a {type(grid).__name__}, and a surface was expected (PolyData, UnstructuredGrid). Take its "
            "surface: pyvista.read(path).extract_surface(algorithm=None).save('surface.vtp')."
        )
    vertex_data = {name: _shaped(grid, "vertex", name, np.asarray(grid.point_data[name])) for name in grid.point_data}
    face_data = {name: _shaped(grid, "face", name, np.asarray(grid.cell_data[name]))[chosen] for name in grid.cell_data}
    return Polygons(np.asarray(grid.points, float), *listed_faces(rows), vertex_data, face_data)


def _polygons(surface):
    """The corners of the faces, and the number of the cell of each: first come vertices, then lines, then polygons,
    then strips."""
    first = surface.n_verts + surface.n_lines
    rows = _lists(surface.GetPolys())
    chosen = list(range(first, first + len(rows)))
    if not surface.n_strips:
        return rows, chosen
    rows = list(rows)
    for number, strip in enumerate(_lists(surface.GetStrips()), len(chosen) + first):
        triangles = strip_triangles(strip)
        rows += list(triangles)
        chosen += [number] * len(triangles)
    return rows, chosen


def _lists(cells):
    if not cells.GetNumberOfCells():
        return []
    offsets, corners = (np.array(part).astype(int) for part in (cells.GetOffsetsArray(), cells.GetConnectivityArray()))
    sizes = np.diff(offsets)
    if (sizes == 3).all():
        return corners.reshape(-1, 3)
    return np.split(corners, offsets[1:-1])


def _cells(grid):
    kinds, offsets = np.asarray(grid.celltypes), np.asarray(grid.cell_offsets).astype(int)
    corners = np.asarray(grid.cell_connectivity).astype(int)
    chosen = np.flatnonzero(~np.isin(kinds, _POINTLIKE))
    others = set(kinds[chosen].tolist()) - {*_POLYGONS, _STRIP, _PIXEL}
    if others:
        raise ValueError(
            f"it holds cells that are no flat faces (of VTK's kinds {', '.join(map(str, sorted(others)))}). Take its "
            "surface: pyvista.read(path).extract_surface(algorithm=None).save('surface.vtp')."
        )
    if (kinds[chosen] == _TRIANGLE).all():
        return corners[offsets[:-1][chosen][:, None] + np.arange(3)], chosen
    rows, numbers = [], []
    for number in chosen:
        row = corners[offsets[number] : offsets[number + 1]]
        faces = [row[[0, 1, 3, 2]]] if kinds[number] == _PIXEL else [row]
        faces = list(strip_triangles(row)) if kinds[number] == _STRIP else faces
        rows += faces
        numbers += [number] * len(faces)
    return rows, numbers


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
