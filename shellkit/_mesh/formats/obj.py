"""Wavefront obj: positions and faces as text, exact. It has no place for named data; texture coordinates, normals,
groups and materials are not read, so that faces stay joined where a texture has a seam."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from .content import Content, Polygons, listed_faces


def read(path: Path) -> Polygons:
    vertices, faces = [], []
    for line in _lines(path):
        key, *words = line.split() or [""]
        if key == "v":
            vertices.append([float(word) for word in words[:3]])
        elif key == "f":
            corners = [int(word.split("/")[0]) for word in words]
            if 0 in corners:
                raise ValueError(f"face {len(faces)} has the corner 0, and an obj file counts from 1.")
            # Negative ones count back from the vertices read so far.
            faces.append([c - 1 if c > 0 else len(vertices) + c for c in corners])
    return Polygons(np.array(vertices, float).reshape(-1, 3), *listed_faces(faces), {}, {})


def _lines(path: Path) -> Iterator[str]:
    """The lines of a file, those that a backslash continues as one."""
    begun = ""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for line in file:
            text = begun + line.rstrip()
            if text.endswith("\\"):
                begun = text[:-1] + " "
            else:
                begun = ""
                yield text
    yield begun


def write(path: Path, content: Content) -> list[str]:
    with path.open("w", encoding="utf-8") as file:
        file.writelines(f"v {x!r} {y!r} {z!r}\n" for x, y, z in content.vertices.tolist())
        file.writelines(f"f {a} {b} {c}\n" for a, b, c in (content.faces + 1).tolist())
    return content.described()
