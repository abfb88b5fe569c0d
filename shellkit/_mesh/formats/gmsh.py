"""Gmsh's msh, through meshio: versions 2.2 to 4.1 are read, 4.1 is written, in binary. Data are float64, and rows are
numbers, vectors of three or 3 x 3 tensors, as the format has it."""

from pathlib import Path

import numpy as np

from .content import Content, refuse_polygons


_POINTLIKE = ("vertex", "line")  # corners and curves of the geometry, which are passed over


def read(path: Path) -> Content:
    from meshio import gmsh

    mesh = gmsh.read(path)
    blocks = [i for i, block in enumerate(mesh.cells) if not block.type.startswith(_POINTLIKE)]
    count = sum(len(mesh.cells[i].data) for i in blocks)
    chosen = [i for i in blocks if mesh.cells[i].type == "triangle"]
    refuse_polygons(count - sum(len(mesh.cells[i].data) for i in chosen), count)
    if not chosen:
        raise ValueError("it holds no triangles.")
    return Content(
        np.asarray(mesh.points, float),
        np.concatenate([mesh.cells[i].data for i in chosen]).astype(int),
        {name: np.asarray(v) for name, v in mesh.point_data.items() if not name.startswith("gmsh:")},
        {name: np.concatenate([np.asarray(v[i]) for i in chosen]) for name, v in mesh.cell_data.items()},
    )


def write(path: Path, content: Content) -> list[str]:
    import meshio

    dropped = []
    vertex_data = _storable(content.vertex_data, "vertex", dropped)
    face_data = {name: [values] for name, values in _storable(content.face_data, "face", dropped).items()}
    mesh = meshio.Mesh(content.vertices, [("triangle", content.faces)], point_data=vertex_data, cell_data=face_data)
    meshio.gmsh.write(path, mesh, fmt_version="4.1", binary=True)
    return dropped


def _storable(data, of, dropped):
    kept = {}
    for name, values in data.items():
        as_float = values.astype(float) if values.dtype.kind in "biuf" else None
        if as_float is None or as_float.astype(values.dtype).tobytes() != values.tobytes():
            dropped.append(f"{of} data {name!r} of type {values.dtype}")
        elif values.shape[1:] in ((), (3,), (3, 3)):
            kept[name] = as_float.reshape(len(values), -1) if values.ndim == 3 else as_float
        else:
            dropped.append(f"{of} data {name!r} of shape {values.shape}")
    return kept
