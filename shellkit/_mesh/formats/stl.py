"""stl: a soup of triangles. Read from both kinds, text and binary, each face with corners of its own; written as text,
which keeps positions exactly where the binary kind has 32 bits. It has no place for data, nor for the numbering."""

from pathlib import Path

import numpy as np

from .content import Content, Polygons


_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER = 84  # a title of 80 bytes and the count; a text file's count does not match its size


def read(path: Path) -> Polygons:
    raw = path.read_bytes()
    count = int.from_bytes(raw[80:_HEADER], "little")
    if len(raw) >= _HEADER and len(raw) == _HEADER + count * _RECORD.itemsize:
        corners = np.frombuffer(raw, _RECORD, count, _HEADER)["corners"].reshape(-1, 3).astype(float)
        sizes = np.full(count, 3)
    else:
        corners, sizes = _text_corners(raw.decode("utf-8-sig", errors="replace"))
    return Polygons(corners, np.arange(len(corners)), sizes, {}, {}, connected=False)


def _text_corners(text):
    corners, sizes, complete = [], [], False
    for line in text.splitlines():
        key, *words = line.split() or [""]
        if key == "outer":
            sizes.append(0)
        elif key == "vertex":
            corners.append([float(word) for word in words])
            sizes[-1] += 1
        complete = complete or key == "endsolid"
    if not complete:
        raise ValueError("it breaks off: a text file ends with endsolid, and a binary one is as long as it announces.")
    return np.array(corners, float).reshape(-1, 3), np.array(sizes, int)


def write(path: Path, content: Content) -> list[str]:
    corners = content.vertices[content.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    with path.open("w", encoding="utf-8") as file:
        file.write("solid shellkit\n")
        for normal, triangle in zip(normals.tolist(), corners.tolist(), strict=True):
            file.write("facet normal {!r} {!r} {!r}\n outer loop\n".format(*normal))
            file.writelines("  vertex {!r} {!r} {!r}\n".format(*corner) for corner in triangle)
            file.write(" endloop\nendfacet\n")
        file.write("endsolid shellkit\n")
    return content.described()
