"""Polylines in SVG and in DXF, with their lengths in millimetres."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np


_COLORS = ("#d55e00", "#0072b2", "#009e73", "#cc79a7")
_COLOR_NUMBERS = (30, 5, 3, 6)  # of AutoCAD: orange, blue, green, magenta
_OUTLINE, _OUTLINE_NUMBER = "#222222", 7


class Drawing(NamedTuple):
    """Lines of each layer and an outline, in millimetres. What is closed ends where it begins."""

    layers: dict[str, list[np.ndarray]]
    outline: list[np.ndarray]
    flat: bool


def write_svg(path: Path, drawing: Drawing, points: np.ndarray) -> None:
    """Writes a flat drawing to scale, with y upwards, around all of the points."""
    low, high = points.min(axis=0)[:2], points.max(axis=0)[:2]
    margin = 0.02 * float((high - low).max())
    width, height = (high - low + 2 * margin).tolist()
    stroke = 0.002 * max(width, height)
    flipped = lambda line: np.stack([line[:, 0] - low[0] + margin, high[1] - line[:, 1] + margin], axis=1)

    def group(name: str, color: str, lines: list[np.ndarray]) -> Iterator[str]:
        yield f'<g id="{name}" stroke="{color}">'
        yield from (f'<path d="{_svg_path(flipped(line))}"/>' for line in lines)
        yield "</g>"

    groups = [("outline", _OUTLINE, drawing.outline)] if drawing.outline else []
    groups += [(name, _COLORS[k % len(_COLORS)], lines) for k, (name, lines) in enumerate(drawing.layers.items())]
    text = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.6g}mm" height="{height:.6g}mm" '
        f'viewBox="0 0 {width:.6g} {height:.6g}" fill="none" stroke-width="{stroke:.4g}" stroke-linejoin="round" '
        'stroke-linecap="round">',
        *(line for each in groups for line in group(*each)),
        "</svg>",
    ]
    path.write_text("\n".join(text) + "\n", encoding="utf-8")


def write_dxf(path: Path, drawing: Drawing, points: np.ndarray) -> None:
    """Writes polylines in the ASCII format of release 12, the points telling the extent of the drawing."""
    groups = [("OUTLINE", _OUTLINE_NUMBER, drawing.outline)] if drawing.outline else []
    for k, (name, lines) in enumerate(drawing.layers.items()):
        groups.append((name.upper().replace(" ", "_"), _COLOR_NUMBERS[k % len(_COLOR_NUMBERS)], lines))
    tags = [(999, "lengths are in millimetres"), (0, "SECTION"), (2, "HEADER"), (9, "$ACADVER"), (1, "AC1009")]
    for name, corner in (("$EXTMIN", points.min(axis=0)), ("$EXTMAX", points.max(axis=0))):
        tags += [(9, name), *_dxf_point(corner)]
    tags += [(0, "ENDSEC"), (0, "SECTION"), (2, "TABLES"), (0, "TABLE"), (2, "LAYER"), (70, len(groups))]
    for name, number, _ in groups:
        tags += [(0, "LAYER"), (2, name), (70, 0), (62, number), (6, "CONTINUOUS")]
    tags += [(0, "ENDTAB"), (0, "ENDSEC"), (0, "SECTION"), (2, "ENTITIES")]
    for name, _, lines in groups:
        for line in lines:
            closed = _is_closed(line)
            kind = (0 if drawing.flat else 8) + (1 if closed else 0)
            tags += [(0, "POLYLINE"), (8, name), (66, 1), (70, kind), *_dxf_point(np.zeros(3))]
            for point in line[:-1] if closed else line:
                tags += [(0, "VERTEX"), (8, name), *_dxf_point(point), *(() if drawing.flat else ((70, 32),))]
            tags += [(0, "SEQEND"), (8, name)]
    tags += [(0, "ENDSEC"), (0, "EOF")]
    path.write_text("".join(f"{code}\n{value}\n" for code, value in tags), encoding="ascii")


def _dxf_point(point: np.ndarray) -> tuple[tuple[int, str], ...]:
    x, y, z = (f"{c:.6f}" for c in (point + 0.0).tolist())
    return (10, x), (20, y), (30, z)


def _svg_path(line: np.ndarray) -> str:
    closed = _is_closed(line)
    return "M" + " ".join(f"{x:.5f},{y:.5f}" for x, y in (line[:-1] if closed else line)) + (" Z" if closed else "")


def _is_closed(line: np.ndarray) -> bool:
    return len(line) > 3 and bool((line[0] == line[-1]).all())
