"""Streamlines as files of machines: SVG and DXF in millimetres, and vtp; on flat sheets and on curved surfaces."""

import os
from pathlib import Path

import numpy as np

from .._actuation.director_layers import Directors
from .._fit.history import FitResult
from .._mesh.mesh import Mesh
from .._mesh.units import millimetres
from .._problem.problem import InverseProblem
from .drawings import Drawing, write_dxf, write_svg
from .placement import streamlines
from .sheet import Sheet, checked_path, require_flat, sheet_of


_OWNER = "export_streamlines"


def export_streamlines(
    path: str | os.PathLike,
    design: Mesh | InverseProblem | FitResult,
    *,
    spacing: float,
    directors: Directors = True,
    closest: float = 0.5,
    unit: str = "mm",
    outline: bool = True,
) -> dict[str, list[np.ndarray]]:
    """Writes evenly spaced lines along the directors of each layer: what a print head or a laser is to follow.

    They are placed by [`shellkit.streamlines`][], on the surface at rest, seen from +z in all layers.

    - **svg**: flat sheets; a group for each layer, drawn to scale: the file says its size in millimetres.
    - **dxf**: flat sheets and curved surfaces; polylines (of three dimensions where the surface is curved) in a layer
        of the drawing for each layer of the shell. Lengths are in millimetres, which a comment says: the format, that
        of release 12, which every program reads, has no place for a unit.
    - **vtp**: lines with the number of their layer as cell data; lengths are those of the mesh.

    **Arguments:**

    - `path`: where to; the extension tells the kind.
    - `design`: a problem, the result of a fit, or a mesh.
    - `spacing`: of the lines, in the unit of the mesh, such as the width of a print head's trace.
    - `directors`: as for [`shellkit.export_directors`][].
    - `closest`: the part of the spacing to which lines may draw near; see [`shellkit.streamlines`][].
    - `unit`: what one unit of the mesh is: `"mm"`, `"cm"`, `"m"`, `"um"` or `"in"`.
    - `outline`: whether to draw the boundary as well, in svg and dxf.

    **Returns:** the lines of each layer, in the unit of the mesh; those of two layers are called `"top"` and
    `"bottom"`.

    **Raises:** `ValueError` for what has no directors, a type of file that is not known, or an svg of a surface that is
    not flat. `FileNotFoundError` for a folder that is not there.

    ??? example

        ```python
        sk.export_streamlines("design.dxf", result, spacing=0.4, unit="mm")
        ```
    """
    to_mm = millimetres(_OWNER, unit)
    path = checked_path(_OWNER, path, (".svg", ".dxf", ".vtp"))
    sheet = sheet_of(_OWNER, design, directors)
    suffix = path.suffix.lower()
    if suffix == ".svg":
        require_flat(_OWNER, sheet, path, "dxf or vtp")
    lines = {name: streamlines(sheet.mesh, angles, spacing, closest) for name, angles in sheet.layers.items()}
    if suffix == ".vtp":
        _write_vtp(path, lines)
        return lines
    scaled = {name: [to_mm * line for line in layer] for name, layer in lines.items()}
    drawing = Drawing(scaled, [to_mm * loop for loop in _outline(sheet)] if outline else [], sheet.is_flat)
    (write_svg if suffix == ".svg" else write_dxf)(path, drawing, to_mm * np.asarray(sheet.mesh.vertices))
    return lines


def _outline(sheet: Sheet) -> list[np.ndarray]:
    points = np.asarray(sheet.mesh.vertices)
    return [points[np.append(loop, loop[0])] for loop in sheet.mesh.boundary_loops()]


def _write_vtp(path: Path, lines: dict[str, list[np.ndarray]]) -> None:
    import pyvista as pv

    every = [line for layer in lines.values() for line in layer]
    starts = np.cumsum([0, *(len(line) for line in every)])
    cells = [np.append(len(line), start + np.arange(len(line))) for line, start in zip(every, starts, strict=False)]
    drawn = pv.PolyData(np.concatenate(every), lines=np.concatenate(cells))
    drawn.cell_data["layer"] = np.repeat(np.arange(len(lines)), [len(layer) for layer in lines.values()])
    drawn.save(path)
