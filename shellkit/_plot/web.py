"""Pictures as pages of the web: one file that can be turned with the mouse, and asks for nothing from elsewhere."""

import html
import pathlib
from collections.abc import Iterator
from typing import Any

from .._package.distribution import DISTRIBUTION


_STYLE = (
    "position:absolute;z-index:9;transform:translate(-50%,50%);pointer-events:none;white-space:nowrap;"
    "font-family:Arial,Helvetica,sans-serif"
)
# No page may ask for anything from elsewhere, and the viewer would like an icon from its home.
_POLICY = "default-src data: blob: 'unsafe-inline' 'unsafe-eval'"
_ICON = "https://kitware.github.io/vtk-js/icon/"


def write_page(plotter: Any, path: pathlib.Path) -> None:
    """Writes what a plotter shows, with its texts laid over it: the viewer in the page draws surfaces and bars only."""
    try:
        import trame_pyvista  # noqa: F401 (gives plotters their `trame`)
    except ImportError as error:
        raise ImportError(f"plot: writing {path} needs trame: pip install '{DISTRIBUTION}[html]'. ({error})") from error
    plotter.trame.export_html(str(path))
    page = path.read_text(encoding="utf-8")
    start, end = page.index("<title>"), page.index("</title>")
    head = f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n<title>{html.escape(path.stem)}'
    page = (page[:start] + head + page[end:]).replace(_ICON, "data:,")
    end = page.rindex("</body>")
    path.write_text(page[:end] + "\n".join(_labels(plotter)) + "\n" + page[end:], encoding="utf-8")


def _labels(plotter: Any) -> Iterator[str]:
    import pyvista as pv

    panels = len(plotter.renderers)
    width, height = plotter.window_size
    for k, renderer in enumerate(plotter.renderers):
        for actor in renderer.actors.values():
            if isinstance(actor, pv.Text):
                x, y = actor.position
                size = 100 * actor.prop.font_size / min(width, height)
                place = f"left:{100 * (k + x) / panels:.2f}%;bottom:{100 * y:.2f}%;font-size:{size:.2f}vmin"
                color = actor.prop.color.hex_rgb
                yield f'<div style="{_STYLE};{place};color:{color}">{html.escape(actor.input)}</div>'
