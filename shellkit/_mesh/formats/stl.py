"""stl: a soup of triangles. Read from both kinds, text and binary, with exactly equal corners merged; written as text,
which keeps positions exactly where the binary kind has 32 bits. It has no place for data, nor for the numbering."""

from pathlib import Path

import numpy as np

from .content import Content, refuse_polygons


_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER = 84  # a title of 80 bytes and the count; a text file's count does not match its size


def read(path: Path) -> Content:
    raw = path.read_bytes()
    count = int.from_bytes(raw[80:_HEADER], "little")
    if len(raw) >= _HEADER and len(raw) == _HEADER + count * _RECORD.itemsize:
        corners = np.frombuffer(raw, _RECORD, count, _HEADER)["corners"].reshape(-1, 3).astype(float)
    else:
        corners = _text_corners(raw.decode("utf-8", errors="replace"))
    corners = corners + 0.0  # no -0.0, which would not compare as equal bytes
    _, first, inverse = np.unique(corners, axis=0, return_index=True, return_inverse=True)
    met = np.argsort(first)
    number = np.empty_like(met)
    number[met] = np.arange(len(met))
    return Content(corners[first[met]], number[inverse].reshape(-1, 3), {}, {})


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
    refuse_polygons(sum(size != 3 for size in sizes), len(sizes))
    return np.array(corners).reshape(-1, 3)


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
