"""How shapes are drawn: one panel each, side by side, all seen by the same camera."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import palette
from .director_lines import director_lines
from .fields import Field
from .shapes import Shape, surface


# What the surface may fill of a panel's height: the rest is for its title, and for a legend or a colour bar.
_TOP, _BOTTOM = 0.10, 0.22
_VIEW_ANGLE = 20.0  # degrees
_MOST_EDGES_SHOWN = 6000
_MATT = {"ambient": 0.5, "diffuse": 0.63, "specular": 0.0}


@dataclass(frozen=True)
class Look:
    """How everything in a picture is drawn."""

    edges: bool | None = None
    color_map: str | None = None
    color_range: tuple[float, float] | None = None
    unit: str | None = None
    stress_unit: str | None = None
    camera: Any = None
    size: tuple[int, int] = (600, 640)
    overlay: bool = True


def stage(
    shapes: Sequence[Shape],
    fields: Sequence[Field | None],
    look: Look,
    *,
    off_screen: bool | None,
    seen: np.ndarray | None = None,
) -> Any:
    """A plotter with a panel for each shape, that shows them all, or all of the points `seen`."""
    import pyvista as pv

    plotter = pv.Plotter(
        shape=(1, len(shapes)),
        off_screen=off_screen,
        window_size=[look.size[0] * len(shapes), look.size[1]],
        border=False,
        lighting="none",
    )
    plotter.background_color = pv.Color("white")
    plotter.enable_anti_aliasing("ssaa")
    _draw(plotter, shapes, fields, look)
    _aim(plotter, len(shapes), points_of(shapes, look.overlay) if seen is None else seen, look.camera)
    return plotter


def points_of(shapes: Sequence[Shape], overlay: bool) -> np.ndarray:
    """All points that are drawn."""
    seen = [shape.points for shape in shapes]
    seen += [shape.target.points for shape in shapes if overlay and shape.target is not None]
    return np.concatenate(seen)


def _draw(plotter: Any, shapes: Sequence[Shape], fields: Sequence[Field | None], look: Look) -> None:
    shown = [field for field in fields if field is not None]
    limits = color_limits(shown) if look.color_range is None else look.color_range
    keyed = next((k for k, shape in enumerate(shapes) if shape.layers), None)
    colored = [k for k, field in enumerate(fields) if field is not None]
    barred = colored[len(colored) // 2] if colored else None
    size = float(min(look.size))
    for k, (shape, field) in enumerate(zip(shapes, fields, strict=True)):
        plotter.subplot(0, k)
        _light(plotter)
        name = f"surface {k}"
        colors = _colors(look.color_map, limits, bool(shape.layers))
        _draw_surface(plotter, shape, field, look.edges, colors, limits, name)
        for level, angles in enumerate(shape.layers[::-1], 1):
            number = len(shape.layers) - level
            dress = (palette.LAYERS[number % 2], f"directors {k} {number}")
            _draw_directors(plotter, shape, angles, level, level < len(shape.layers), *dress)
        if look.overlay and shape.target is not None:
            _draw_wireframe(plotter, shape.target, f"target {k}")
        _write(plotter, shape.title, 0.5, 1 - 0.5 * _TOP, size / 26, palette.TEXT, f"title {k}")
        if k == barred and field is not None:
            _draw_bar(plotter, name, field.heading(look.unit, look.stress_unit), size)
        if k == keyed:
            _draw_key(plotter, shape, size)


def color_limits(fields: Sequence[Field]) -> tuple[float, float] | None:
    """One range for all panels: symmetric about zero for values of either sign, from zero where they begin near it."""
    if not fields:
        return None
    values = np.concatenate([field.values for field in fields])
    values = values[np.isfinite(values)]
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    if low < 0 < high and min(-low, high) > 0.05 * max(-low, high):
        return -max(-low, high), max(-low, high)
    if 0 <= low < 0.5 * high:
        low = 0.0
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def _colors(name: str | None, limits: tuple[float, float] | None, under_lines: bool) -> Any:
    symmetric = limits is not None and limits[0] == -limits[1]
    sequential = palette.UNDER_LINES if under_lines else palette.SEQUENTIAL
    return palette.color_map(name or (palette.DIVERGING if symmetric else sequential), 0.5 if under_lines else 0.0)


def _light(plotter: Any) -> None:
    """A strong light from the upper left and a weak one from the lower right, which go with the camera."""
    import pyvista as pv

    for position, intensity in (((-0.6, 0.9, 1.0), 0.78), ((1.0, -0.6, 0.7), 0.4)):
        plotter.add_light(pv.Light(position=position, intensity=intensity, light_type="camera light"), only_active=True)


def _draw_surface(
    plotter: Any, shape: Shape, field: Field | None, edges: bool | None, colors: Any, limits: Any, name: str
) -> None:
    drawn = surface(shape)
    look: dict[str, Any] = {"color": palette.SURFACE}
    if field is not None:
        per_vertex = len(field.values) == shape.mesh.n_vertices
        (drawn.point_data if per_vertex else drawn.cell_data)[field.name or "color"] = field.values
        look = {"scalars": field.name or "color", "preference": "point" if per_vertex else "cell", "cmap": colors}
        look |= {"clim": limits, "show_scalar_bar": False, "nan_color": palette.SURFACE}
    many = shape.mesh.n_faces > _MOST_EDGES_SHOWN
    plotter.add_mesh(
        drawn,
        name=name,
        show_edges=not many if edges is None else edges,
        edge_color=palette.EDGES,
        edge_opacity=0.45,
        line_width=1.0,
        smooth_shading=many,
        **_MATT,
        reset_camera=False,
        **look,
    )


def _draw_directors(
    plotter: Any, shape: Shape, angles: np.ndarray, level: int, covered: bool, color: str, name: str
) -> None:
    import pyvista as pv

    tails, heads, radius = director_lines(shape.mesh, shape.points, angles, level)
    ends = np.stack([tails, heads], axis=1).reshape(-1, 3)
    # What lies below another layer is thicker, to be seen where both have the same direction.
    tubes = pv.line_segments_from_points(ends).tube(radius=1.4 * radius if covered else radius, n_sides=8, capping=True)
    plotter.add_mesh(tubes, name=name, color=color, ambient=0.75, diffuse=0.3, smooth_shading=True, reset_camera=False)


def _draw_wireframe(plotter: Any, shape: Shape, name: str) -> None:
    plotter.add_mesh(
        surface(shape),
        name=name,
        style="wireframe",
        color=palette.TARGET,
        line_width=1.6,
        lighting=False,
        reset_camera=False,
    )


def _write(plotter: Any, text: str, x: float, y: float, size: float, color: str, name: str) -> None:
    if not text:
        return
    actor = plotter.add_text(text, position=(x, y), viewport=True, font_size=1, color=color, name=name)
    actor.prop.font_size = max(8, round(size))
    actor.prop.justification_horizontal = "center"
    actor.prop.justification_vertical = "center"


def _draw_key(plotter: Any, shape: Shape, size: float) -> None:
    """Which colour is which layer."""
    labels = ("directors",) if len(shape.layers) == 1 else ("top directors", "bottom directors")
    places = (0.5,) if len(shape.layers) == 1 else (0.3, 0.7)
    for label, place, color in zip(labels, places, palette.LAYERS, strict=False):
        _write(plotter, label, place, 0.84 * _BOTTOM, size / 32, color, f"key {label}")


def _draw_bar(plotter: Any, surface_name: str, heading: str, size: float) -> None:
    width = 0.7 * size / plotter.renderer.GetSize()[0]
    bar = plotter.add_scalar_bar(
        title=f"bar of {surface_name}",
        mapper=plotter.renderer.actors[surface_name].mapper,
        vertical=False,
        width=width,
        height=0.075,
        position_x=0.5 - 0.5 * width,
        position_y=0.02,
        n_labels=3,
        fmt="%.3g",
        color=palette.TEXT,
        label_font_size=max(8, round(size / 36)),
        unconstrained_font_size=True,
    )
    bar.SetTitle("")
    bar.SetTextPositionToPrecedeScalarBar()
    bar.SetTextPad(round(size / 100))  # between the numbers and the bar
    _write(plotter, heading, 0.5, 0.55 * _BOTTOM, size / 32, palette.TEXT, f"heading of {surface_name}")


def _aim(plotter: Any, panels: int, points: np.ndarray, camera: Any) -> None:
    """One camera for all panels, as near as lets all points be seen."""
    plotter.link_views()
    plotter.subplot(0, 0)
    if isinstance(camera, str) or (camera is not None and np.shape(camera) != (3,)):
        plotter.camera_position = camera
        return
    toward = default_direction(points) if camera is None else np.asarray(camera, float)
    toward = toward / np.linalg.norm(toward)
    up = np.array([0.0, 0.0, 1.0]) if abs(toward[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, toward)
    right /= np.linalg.norm(right)
    up = np.cross(toward, right)

    wide = plotter.window_size[0] / panels / plotter.window_size[1]
    usable = 1 - _TOP - _BOTTOM
    slope = np.tan(np.deg2rad(_VIEW_ANGLE) / 2)
    axes = np.stack([right, up, toward])
    seen_along = points @ axes.T
    middle = 0.5 * (seen_along.min(0) + seen_along.max(0))
    x, y, z = (seen_along - middle).T
    # A point is in view if it is no further from the axis than the slope times its depth.
    distance = float(np.max(z + np.maximum(np.abs(x) / (0.94 * wide), np.abs(y) / usable) / slope))
    focus = middle @ axes
    view = plotter.camera
    view.view_angle = _VIEW_ANGLE
    view.focal_point, view.position, view.up = focus, focus + distance * toward, up
    view.SetWindowCenter(0.0, _TOP - _BOTTOM)
    for k in range(panels):
        plotter.subplot(0, k)
        plotter.reset_camera_clipping_range()


def default_direction(points: np.ndarray) -> np.ndarray:
    """From a little above, and from further above what is flat."""
    extent = np.ptp(points, axis=0)
    flat = extent[2] < 0.35 * extent[:2].max()
    return np.array([0.45, -1.0, 1.0 if flat else 0.38])
