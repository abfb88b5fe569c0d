"""The one entry to pictures of surfaces: what is asked for is checked here, and the parts are put together."""

import dataclasses
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import ArrayLike

from .._actuation.director_layers import Directors
from .._align.aligners import Aligner
from .._fit.history import FitResult
from .._problem.problem import InverseProblem
from .fields import Field, field_from, field_names, field_of
from .opengl import has_display, require_opengl
from .scene import Look, stage
from .shapes import Drawable, Shape, Target, shapes_of
from .web import write_page


if TYPE_CHECKING:
    from pyvista import Plotter


_PIXELS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
_VECTORS = (".svg", ".pdf", ".eps", ".ps")


def plot(
    thing: Drawable | Sequence[Drawable],
    *,
    color: str | ArrayLike | bool | None = None,
    name: str | None = None,
    unit: str | None = None,
    stress_unit: str | None = None,
    color_map: str | None = None,
    color_range: tuple[float, float] | None = None,
    directors: Directors = True,
    target: Target = None,
    aligner: Aligner | None = None,
    problem: InverseProblem | None = None,
    edges: bool | None = None,
    title: str | Sequence[str] | None = None,
    camera: Any = None,
    size: tuple[int, int] = (600, 640),
    save: str | os.PathLike | None = None,
    show: bool = False,
) -> "Plotter":
    """Draws a surface with its fields and directors, or several side by side, seen by one camera.

    What is drawn depends on the thing: of a [`shellkit.Mesh`][] the surface, of an [`shellkit.Equilibrium`][] the
    relaxed surface, of an [`shellkit.InverseProblem`][] the surface at rest with the directors that are to be imprinted
    on it, of a [`shellkit.FitResult`][] the best design: at rest, relaxed, and beside its target, of a
    [`shellkit.Path`][] up to four of its equilibria.

    Directors are drawn as lines a little off the side that normals point to, in vermilion for the top layer and in blue
    below it for the bottom one. On a relaxed surface they are carried along with the material. On a fine mesh only an
    evenly spread part of them is drawn.

    Drawn without a screen unless `show` is set; that needs OpenGL, on a bare Debian or Ubuntu the packages
    `libegl1 libgl1-mesa-dri`.

    **Arguments:**

    - `thing`: what to draw, or a list of such things, each in a panel of its own.
    - `color`: what to colour the surface by: an array with one number per vertex or face, or a name. Any surface has
        `"mean curvature"`, `"gauss curvature"` and the names in `mesh.vertex_data` and `mesh.face_data`. An equilibrium
        also has `"displacement"` (from the surface at rest), `"stretch"` (the larger principal stretch against the
        surface at rest) and `"strain"` (the larger deviation from 1 of the principal stretches against the actuated
        rest metric, the elastic part); it and a problem have `"actuation"` (the larger principal stretch of the
        actuated rest metric) and `"thickness"`. With a target there is `"error"`, the distance of each vertex from its
        partner in the target (from the nearest point of a target with other vertices). Where the problem of an
        equilibrium is known, there are `"stress"` (von Mises, of [`shellkit.membrane_stress`][]) and
        `"energy density"` ([`shellkit.energy_density`][]). `None`: the error if there is a target, else the
        displacement of an equilibrium, else nothing. `False`: nothing. A panel without the field stays plain.
    - `name`: the heading of the colour bar for an array.
    - `unit`: the unit of length for the colour bar, such as `"mm"`.
    - `stress_unit`: that of the moduli, such as `"MPa"`.
    - `color_map`: the name of a map of matplotlib; by default `cividis`, or `PuOr_r` around zero for values of either
        sign. Under directors the map is paler, and `Purples` by default.
    - `color_range`: the ends of the map; by default those of all panels together.
    - `directors`: `True` for those of the problem, if any; `False` for none; else an [`shellkit.Actuation`][], or one
        or more arrays of angles at rest, shape `(F,)`, the top layer first.
    - `target`: what the shape should be: positions of the vertices, shape `(V, 3)`, a mesh, an equilibrium, or a
        problem (relaxed for it, with its directors). Drawn over the surface as a wireframe; of a fit, in a panel of its
        own, and by default the target of its [`shellkit.VertexDistance`][].
    - `aligner`: how a shape is laid on the target. By default that of the fit's loss; [`shellkit.Kabsch`][] for an
        equilibrium; a mesh stays where it is.
    - `problem`: what an equilibrium or a path belongs to: for its directors, its stress and its energy density.
    - `edges`: whether to draw the edges of the mesh; by default, unless it is fine.
    - `title`: a line above the picture, or one for each panel.
    - `camera`: the direction in which the camera stands, seen from the surface, three numbers; or a camera position of
        pyvista's, such as `"xy"`.
    - `size`: width and height of a panel in pixels.
    - `save`: a file to write: png, jpg, tif or bmp; svg, pdf, eps or ps; html (interactive, in one file; needs the
        extra `html`); gltf.
    - `show`: open a window, and wait until it is closed.

    **Returns:** the pyvista `Plotter`. At the end of a cell of a notebook it shows as a picture; its `show()` is
    interactive.

    **Raises:** `ValueError` for a thing that cannot be drawn, an unknown name (with those that there are), an array
    that fits neither vertices nor faces, a file type that cannot be written, or `show` without a screen.
    `RuntimeError` where there is no OpenGL.

    ??? example

        ```python
        sk.plot(mesh, color="mean curvature", save="curvature.png")
        sk.plot(problem(), problem=problem, color="stress", stress_unit="MPa")
        sk.plot(sk.fit(problem, optax.adam(0.1), steps=200), save="design.png")
        ```
    """
    if show and not has_display():
        raise ValueError("plot: show=True needs a screen, and there is none; write the picture to a file with save=...")
    path = None if save is None else _checked_path(save)
    things = list(thing) if isinstance(thing, Sequence) else [thing]
    shapes = [shape for each in things for shape in shapes_of(each, directors, target, aligner, problem)]
    if not shapes:
        raise ValueError("plot: an empty list; give at least one thing to draw.")
    shapes = _titled(shapes, title)
    fields = fields_of(shapes, color, name)

    require_opengl()
    look = Look(
        edges=edges,
        color_map=color_map,
        color_range=color_range,
        unit=unit,
        stress_unit=stress_unit,
        camera=camera,
        size=size,
        overlay=not any(isinstance(each, FitResult) for each in things),
    )
    off_screen = (path is not None and not show) or not has_display()
    plotter = stage(shapes, fields, look, off_screen=off_screen or None)
    if show:
        plotter.show(auto_close=False)
    if path is not None and path.suffix.lower() not in _PIXELS:
        _export(plotter, path)
    elif path is not None or plotter.off_screen:
        # The last image is what a notebook shows.
        plotter.last_image = plotter.screenshot(None if path is None else str(path), return_img=True)
    return plotter


def _checked_path(save: str | os.PathLike) -> Path:
    path = Path(save)
    known = (*_PIXELS, *_VECTORS, ".html", ".gltf")
    if path.suffix.lower() not in known:
        raise ValueError(f"plot: cannot write {path}: the type {path.suffix!r} is none of {', '.join(known)}.")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"plot: cannot write {path}: there is no folder {path.parent}.")
    return path


def _export(plotter: "Plotter", path: Path) -> None:
    suffix = path.suffix.lower()
    if suffix in _VECTORS:
        plotter.save_graphic(str(path))
    elif suffix == ".gltf":
        plotter.export_gltf(str(path))
    else:
        write_page(plotter, path)


def _titled(shapes: list[Shape], title: str | Sequence[str] | None) -> list[Shape]:
    if title is None:
        return shapes
    titles = [title] + [""] * (len(shapes) - 1) if isinstance(title, str) else list(title)
    if len(titles) != len(shapes):
        raise ValueError(f"plot: {len(titles)} titles for {len(shapes)} panels; give one for each, or one text.")
    return [dataclasses.replace(shape, title=text) for shape, text in zip(shapes, titles, strict=True)]


def fields_of(shapes: list[Shape], color: str | ArrayLike | bool | None, name: str | None) -> list[Field | None]:
    """The field of each panel."""
    if isinstance(color, bool) and not color:
        return [None] * len(shapes)
    if color is None:
        if any(shape.target is not None for shape in shapes):
            color = "error"
        elif any(shape.equilibrium is not None for shape in shapes):
            color = "displacement"
        else:
            return [None] * len(shapes)
    if not isinstance(color, str):
        return [field_from(np.asarray(color), name, shape.mesh) for shape in shapes]
    fields = [field_of(shape, color) for shape in shapes]
    if all(field is None for field in fields):
        known = dict.fromkeys(each for shape in shapes for each in field_names(shape))
        raise ValueError(f"plot: there is no field named {color!r} here; there are: {', '.join(map(repr, known))}.")
    return fields
