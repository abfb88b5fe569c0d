"""Geomview off: positions and faces as text, exact. It has no place for named data; colours are not read."""

from pathlib import Path

import numpy as np

from .content import Content, triangles


def read(path: Path) -> Content:
    text = path.read_text(encoding="utf-8", errors="replace")
    lines = [words for line in text.splitlines() if (words := line.split("#")[0].split())]
    if not lines or not lines[0][0].endswith("OFF"):
        raise ValueError("the first word is not OFF.")
    if lines[0][0] != "OFF":
        raise ValueError(f"the variant {lines[0][0]} is not supported, plain OFF is.")
    lines[:1] = [lines[0][1:]] if len(lines[0]) > 1 else []  # the counts may stand beside the word OFF
    n_vertices, n_faces = (int(word) for word in lines[0][:2])
    vertices, faces = lines[1 : 1 + n_vertices], lines[1 + n_vertices : 1 + n_vertices + n_faces]
    if len(faces) < n_faces:
        raise ValueError(f"it announces {n_vertices} vertices and {n_faces} faces, but ends before the last of them.")
    corners = [[int(word) for word in face[1 : 1 + int(face[0])]] for face in faces]
    return Content(np.array([v[:3] for v in vertices], float), triangles(corners), {}, {})


def write(path: Path, content: Content) -> list[str]:
    with path.open("w", encoding="utf-8") as file:
        file.write(f"OFF\n{len(content.vertices)} {len(content.faces)} 0\n")
        file.writelines(f"{x!r} {y!r} {z!r}\n" for x, y, z in content.vertices.tolist())
        file.writelines(f"3 {a} {b} {c}\n" for a, b, c in content.faces.tolist())
    return content.described()
