"""Director fields as files: for programs (vtu, vtp, vtk), for tables (csv), and for projectors that align a flat sheet
by light (png)."""

import csv
import os
from pathlib import Path

import numpy as np

from .._actuation.director_layers import Directors
from .._fit.history import FitResult
from .._geometry.directors import directors as vectors
from .._mesh.mesh import Mesh
from .._mesh.units import millimetres
from .._problem.problem import InverseProblem
from .sheet import Sheet, checked_path, require_flat, sheet_of


_OWNER = "export_directors"
_MESHES = (".vtu", ".vtp", ".vtk")
_PIXELS_ACROSS = 1024


def export_directors(
    path: str | os.PathLike,
    design: Mesh | InverseProblem | FitResult,
    *,
    directors: Directors = True,
    unit: str = "mm",
    pixel: float | None = None,
) -> list[Path]:
    """Writes the director field of each layer, on the surface at rest.

    - **vtu, vtp, vtk**: the mesh, with the vectors and the angles of each layer as face data; lengths are those of the
        mesh, which these formats hold without a unit.
    - **csv**: a row per face: its centre, its area, and for each layer the vector, and on a flat sheet the angle from
        the x axis in degrees, from 0 up to 180. The unit stands in the heading.
    - **png**: for a flat sheet, a picture for each layer, seen from +z with y upwards, in which grey is the angle from
        the x axis: level 0 to 255 for 0 to 180 degrees (angle = 180° level / 256). What is off the sheet is
        transparent. The size of a pixel is written into the file.

    **Arguments:**

    - `path`: where to; the extension tells the kind. Of a png with several layers, `design.png` becomes
        `design-top.png` and `design-bottom.png`.
    - `design`: a problem, the result of a fit, or a mesh.
    - `directors`: `True` for those of the actuation; else an [`shellkit.Actuation`][], or one or more arrays of angles,
        radians from the first edge of each face, shape `(F,)`, the top layer first.
    - `unit`: what one unit of the mesh is: `"mm"`, `"cm"`, `"m"`, `"um"` or `"in"`.
    - `pixel`: side of a pixel of a png, in the unit of the mesh; by default 1024 pixels span the longer side.

    **Returns:** the paths written.

    **Raises:** `ValueError` for what has no directors, a type of file that is not known, or a png of a surface that is
    not flat. `FileNotFoundError` for a folder that is not there.

    ??? example

        ```python
        sk.export_directors("design.csv", sk.fit(problem, optax.adam(0.1), steps=200), unit="mm")
        ```
    """
    to_mm = millimetres(_OWNER, unit)
    path = checked_path(_OWNER, path, (*_MESHES, ".csv", ".png"))
    sheet = sheet_of(_OWNER, design, directors)
    suffix = path.suffix.lower()
    if suffix in _MESHES:
        data = {f"{name} angle": angles for name, angles in sheet.layers.items()}
        data |= {f"{name} vector": np.asarray(vectors(sheet.mesh, angles)) for name, angles in sheet.layers.items()}
        Mesh(sheet.mesh.vertices, sheet.mesh.faces).write(path, face_data=data)
        return [path]
    if suffix == ".csv":
        _write_table(path, sheet, unit)
        return [path]
    require_flat(_OWNER, sheet, path, "csv or vtu")
    pixel = sheet.extent / _PIXELS_ACROSS if pixel is None else pixel
    if not (np.isfinite(pixel) and pixel > 0):
        raise ValueError(f"{_OWNER}: pixel is {pixel}; give a positive length in the unit of the mesh.")
    single = len(sheet.layers) == 1
    paths = [path if single else path.with_stem(f"{path.stem}-{name.replace(' ', '-')}") for name in sheet.layers]
    for each, angles in zip(paths, sheet.layers.values(), strict=True):
        _write_picture(each, sheet.mesh, angles, pixel, to_mm)
    return paths


def _degrees(mesh: Mesh, angles: np.ndarray) -> np.ndarray:
    """Angles of the directors of a flat sheet from the x axis, in [0, 180)."""
    d = np.asarray(vectors(mesh, angles))
    # What rounding puts just below 180 is 0.
    degrees = np.rad2deg(np.arctan2(d[:, 1], d[:, 0])) % 180
    return np.where(degrees > 180 - 1e-9, 0.0, degrees)


def _write_table(path: Path, sheet: Sheet, unit: str) -> None:
    corners = np.asarray(sheet.mesh.vertices)[np.asarray(sheet.mesh.faces)]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    heading = ["face", f"x ({unit})", f"y ({unit})", f"z ({unit})", f"area ({unit}^2)"]
    columns = [np.arange(sheet.mesh.n_faces), *corners.mean(axis=1).T, areas]
    for name, angles in sheet.layers.items():
        heading += [f"{name} {axis}" for axis in "xyz"]
        columns += [*np.asarray(vectors(sheet.mesh, angles)).T]
        if sheet.is_flat:
            heading.append(f"{name} angle (deg)")
            columns.append(_degrees(sheet.mesh, angles))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(heading)
        writer.writerows(zip(*(column.tolist() for column in columns), strict=True))


def _write_picture(path: Path, mesh: Mesh, angles: np.ndarray, pixel: float, to_mm: float) -> None:
    from PIL import Image

    points = np.asarray(mesh.vertices)[:, :2]
    low, high = points.min(axis=0), points.max(axis=0)
    width, height = (max(1, round(side / pixel)) for side in (high - low).tolist())
    levels = np.floor(_degrees(mesh, angles) * (256 / 180)).astype(np.uint8)
    picture = np.zeros((height, width, 2), np.uint8)
    for triangle, level in zip((points[np.asarray(mesh.faces)] - low) / pixel, levels, strict=True):
        columns, rows = (
            slice(*_pixels_between(side, most)) for side, most in zip(triangle.T, (width, height), strict=True)
        )
        x, y = np.meshgrid(np.arange(width)[columns] + 0.5, np.arange(height)[rows] + 0.5)
        ahead = np.roll(triangle, -1, axis=0) - triangle
        left = [e[0] * (y - p[1]) - e[1] * (x - p[0]) for e, p in zip(ahead, triangle, strict=True)]
        # A sheet may be seen from below, where corners run the other way.
        inside = (np.min(left, axis=0) >= -1e-9) | (np.max(left, axis=0) <= 1e-9)
        picture[rows, columns][inside] = level, 255
    per_inch = 25.4 / (pixel * to_mm)
    Image.fromarray(picture[::-1].copy(), "LA").save(path, dpi=(per_inch, per_inch))


def _pixels_between(ends: np.ndarray, most: int) -> tuple[int, int]:
    """The first and one past the last pixel whose middle may lie between."""
    return max(0, int(np.floor(ends.min()))), min(most, int(np.ceil(ends.max())))
