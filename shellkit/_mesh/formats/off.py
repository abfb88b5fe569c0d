"""Geomview off: positions and faces as text, exact. It has no place for named data; colours, normals and texture
coordinates (COFF, NOFF, STOFF) are not read."""

import re
from pathlib import Path

import numpy as np

from .content import Content, Polygons, listed_faces


def read(path: Path) -> Polygons:
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    lines = [words for line in text.splitlines() if (words := line.split("#")[0].split())]
    if not lines or not lines[0][0].endswith("OFF"):
        raise ValueError("the first word is not OFF.")
    # What a variant adds stands behind the three coordinates of a vertex.
    if not re.fullmatch("(ST)?C?N?OFF", lines[0][0]) or lines[0][1:2] == ["BINARY"]:
        raise ValueError(
            f"the variant {' '.join(lines[0][:2])} is not supported: OFF, COFF, NOFF and STOFF as text are. Save it as "
            "one of these, or as ply."
        )
    lines[:1] = [lines[0][1:]] if len(lines[0]) > 1 else []  # the counts may stand beside the word OFF
    n_vertices, n_faces = (int(word) for word in lines[0][:2])
    vertices, faces = lines[1 : 1 + n_vertices], lines[1 + n_vertices : 1 + n_vertices + n_faces]
    if len(vertices) < n_vertices or len(faces) < n_faces:
        raise ValueError(f"it announces {n_vertices} vertices and {n_faces} faces, but ends before the last of them.")
    corners = [[int(word) for word in face[1 : 1 + int(face[0])]] for face in faces]
    return Polygons(np.array([v[:3] for v in vertices], float).reshape(-1, 3), *listed_faces(corners), {}, {})


def write(path: Path, content: Content) -> list[str]:
    with path.open("w", encoding="utf-8") as file:
        file.write(f"OFF\n{len(content.vertices)} {len(content.faces)} 0\n")
        file.writelines(f"{x!r} {y!r} {z!r}\n" for x, y, z in content.vertices.tolist())
        file.writelines(f"3 {a} {b} {c}\n" for a, b, c in content.faces.tolist())
    return content.described()
