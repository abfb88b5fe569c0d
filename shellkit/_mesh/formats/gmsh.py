"""Gmsh's msh, through meshio: versions 2.2 to 4.1 are read, 4.1 is written, in binary. Data are float64, and rows are
numbers, vectors of three or 3 x 3 tensors, as the format has it."""

from pathlib import Path

import numpy as np

from .content import Content, Polygons, listed_faces


_POINTLIKE = ("vertex", "line")  # corners and curves of the geometry, which are passed over
_FLAT = ("triangle", "quad", "polygon")


def read(path: Path) -> Polygons:
    from meshio import gmsh

    mesh = gmsh.read(path)
    blocks = [i for i, block in enumerate(mesh.cells) if not block.type.startswith(_POINTLIKE)]
    others = sorted({mesh.cells[i].type for i in blocks} - set(_FLAT))
    if others:
        raise ValueError(
            f"it holds cells of the kinds {', '.join(others)}, which are no flat faces. Mesh surfaces only and to "
            "first order, as by: gmsh -2 -order 1 shape.geo -o shape.msh."
        )
    faces = [listed_faces(np.asarray(mesh.cells[i].data)) for i in blocks]
    none = np.zeros(0, int)
    corners, sizes = (np.concatenate([none, *(part[k] for part in faces)]) for k in (0, 1))
    return Polygons(
        np.asarray(mesh.points, float),
        corners,
        sizes,
        {name: np.asarray(v) for name, v in mesh.point_data.items() if not name.startswith("gmsh:")},
        {name: np.concatenate([np.asarray(v[i]) for i in blocks]) for name, v in mesh.cell_data.items() if blocks},
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
