"""Wavefront obj: positions and faces as text, exact. It has no place for named data; texture coordinates, normals,
groups and materials are not read."""

from pathlib import Path

import numpy as np

from .content import Content, triangles


def read(path: Path) -> Content:
    vertices, faces = [], []
    with path.open(encoding="utf-8", errors="replace") as file:
        for line in file:
            key, *words = line.split() or [""]
            if key == "v":
                vertices.append([float(word) for word in words[:3]])
            elif key == "f":
                corners = [int(word.split("/")[0]) for word in words]
                # Indices count from one; negative ones count back from the vertices read so far.
                faces.append([c - 1 if c > 0 else len(vertices) + c for c in corners])
    return Content(np.array(vertices).reshape(-1, 3), triangles(faces), {}, {})


def write(path: Path, content: Content) -> list[str]:
    with path.open("w", encoding="utf-8") as file:
        file.writelines(f"v {x!r} {y!r} {z!r}\n" for x, y, z in content.vertices.tolist())
        file.writelines(f"f {a} {b} {c}\n" for a, b, c in (content.faces + 1).tolist())
    return content.described()
