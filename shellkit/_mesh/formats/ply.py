"""Stanford ply: positions, faces and data of both, exact, in binary. Numbers are scalar properties of a vertex or a
face, vectors are lists of fixed length. The format has no 64-bit integers: they are kept where 32 bits hold them.
Triangle strips are read as well."""

import codecs
from pathlib import Path

import numpy as np

from .content import Content, Polygons, listed_faces, strip_triangles


_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"},
    **{"int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8"},
}
_NAMES = {np.dtype(code): name for name, code in reversed(_TYPES.items())}
_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def read(path: Path) -> Polygons:
    with path.open("rb") as file:
        order, elements = _header(file)
        body = file.read()
    records = _TextRecords(body) if order == "" else _BinaryRecords(body, order)
    tables = {name: _table(records, count, properties) for name, count, properties in elements}
    vertex, face = tables.get("vertex", {}), tables.get("face", {})
    if not vertex.keys() >= set("xyz"):
        raise ValueError("its vertices have no positions x, y and z.")
    points = np.stack([vertex.pop(axis) for axis in "xyz"], axis=1).astype(float)
    rows = _pop_corners(face)
    if rows is None:
        strips = _pop_corners(tables.get("tristrips", {}))
        rows, face = [] if strips is None else _from_strips(strips), {}
    return Polygons(points, *listed_faces(rows), _rectangular(vertex), _rectangular(face))


def _pop_corners(table):
    """The vertex indices of an element, taken out of its properties; None where it has none."""
    for name in ("vertex_indices", "vertex_index"):
        if name in table and len(table[name]):
            return table.pop(name)
    return None


def _from_strips(strips):
    """Triangles from strips, of which a list may hold several, with -1 between them."""
    pieces = []
    for strip in strips:
        strip = np.asarray(strip, int)
        pieces += [piece[piece >= 0] for piece in np.split(strip, np.flatnonzero(strip < 0))]
    return np.concatenate([np.zeros((0, 3), int), *(strip_triangles(piece) for piece in pieces if len(piece) > 2)])


def _header(file):
    if file.readline().strip().removeprefix(codecs.BOM_UTF8) != b"ply":
        raise ValueError("the first line is not 'ply'.")
    order, elements = None, []
    for line in iter(file.readline, b""):
        key, *words = line.decode("utf-8", errors="replace").split() or [""]
        if key == "end_header":
            break
        if key == "format":
            order = _FORMATS[words[0]]
        elif key == "element":
            elements.append((words[0], int(words[1]), []))
        elif key == "property":
            elements[-1][2].append((words[-1], [np.dtype(_TYPES[word]) for word in words[:-1] if word != "list"]))
    if order is None:
        raise ValueError("the header names no format.")
    return order, elements


class _BinaryRecords:
    """Takes arrays of a structured type off a string of bytes."""

    def __init__(self, body, order):
        self.body, self.order, self.at = body, order, 0

    def take(self, fields, count):
        dtype = np.dtype([(name, kind.newbyteorder(self.order), shape) for name, kind, shape in fields])
        values = np.frombuffer(self.body, dtype, count, self.at)
        self.at += values.nbytes
        return values


class _TextRecords:
    """The same from text, where each number is a word."""

    def __init__(self, body):
        self.words, self.at = body.split(), 0

    def take(self, fields, count):
        values = np.empty(count, np.dtype(fields))
        ends = np.cumsum([shape[0] if shape else 1 for _, _, shape in fields])
        words = np.array(self.words[self.at : self.at + ends[-1] * count]).reshape(count, ends[-1])
        self.at += words.size
        for (name, kind, _), part in zip(fields, np.split(words, ends[:-1], axis=1), strict=True):
            values[name] = part.astype(kind).reshape(values[name].shape)
        return values


def _table(records, count, properties):
    """The properties of all items of an element; a list of varying length becomes a Python list of arrays."""
    if not count:
        return {name: np.empty(0) for name, _ in properties}
    start = records.at
    lengths = [values.shape[1:] for values in _record(records, properties)]
    records.at = start
    fields = []
    for (name, kinds), length in zip(properties, lengths, strict=True):
        fields += [(f"{name} count", kinds[0], ())] * (len(kinds) == 2) + [(name, kinds[-1], length)]
    try:
        values = records.take(fields, count)
        if all(
            (values[f"{name} count"] == values[name].shape[1]).all() for name, kinds in properties if len(kinds) == 2
        ):
            return {name: values[name] for name, _ in properties}
    except ValueError:  # the bytes run out where lists are longer at first than later
        pass
    records.at = start
    rows = [_record(records, properties) for _ in range(count)]
    return {name: [row[i][0] for row in rows] for i, (name, _) in enumerate(properties)}


def _record(records, properties):
    values = []
    for name, kinds in properties:
        shape = ()
        if len(kinds) == 2:
            shape = (int(records.take([(name, kinds[0], ())], 1)[name][0]),)
        values.append(records.take([(name, kinds[-1], shape)], 1)[name])
    return values


def _rectangular(table):
    """The properties that make an array, without lists of varying length."""
    ragged = {name for name, v in table.items() if isinstance(v, list) and len({row.shape for row in v}) > 1}
    return {name: np.array(v) for name, v in table.items() if name not in ragged}


def write(path: Path, content: Content) -> list[str]:
    dropped = []
    corners = {"vertex_indices": content.faces.astype(np.int32)}
    axes = dict(zip("xyz", content.vertices.T, strict=True))
    vertex = {**axes, **_storable(content.vertex_data, "vertex", dropped)}
    face = {**corners, **_storable(content.face_data, "face", dropped)}
    with path.open("wb") as file:
        file.write(b"ply\nformat binary_little_endian 1.0\ncomment written by shellkit\n")
        for name, n, table in (("vertex", len(content.vertices), vertex), ("face", len(content.faces), face)):
            file.write(f"element {name} {n}\n".encode())
            for key, values in table.items():
                kind = _NAMES[values.dtype]
                file.write(f"property {f'list uchar {kind}' if values.ndim == 2 else kind} {key}\n".encode())
        file.write(b"end_header\n")
        file.write(_packed(vertex))
        file.write(_packed(face))
    return dropped


def _storable(data, of, dropped):
    kept = {}
    for name, values in data.items():
        narrow = values
        if values.dtype == bool:
            narrow = values.astype(np.uint8)
        elif values.dtype.itemsize == 8 and np.issubdtype(values.dtype, np.integer):
            narrow = values.astype(np.int32)
        taken = name in ("x", "y", "z", "vertex_indices", "vertex_index") or name.split() != [name]
        fits = narrow.dtype in _NAMES and values.ndim <= 2 and values.size < 256 * len(values)
        if fits and not taken and np.array_equal(narrow, values):
            kept[name] = narrow
        else:
            dropped.append(f"{of} data {name!r}")
    return kept


def _packed(table):
    fields, columns = [], []
    for name, values in table.items():
        if values.ndim == 2:
            fields.append((f"{name} count", "u1"))
            columns.append(values.shape[1])
        fields.append((name, values.dtype.newbyteorder("<"), values.shape[1:]))
        columns.append(values)
    packed = np.empty(len(next(iter(table.values()))), fields)
    for (name, *_), values in zip(fields, columns, strict=True):
        packed[name] = values
    return packed.tobytes()
