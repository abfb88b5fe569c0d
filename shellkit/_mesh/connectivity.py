"""Who is next to whom: edges, the faces of an edge, the edges of a face, and what lies across each edge. Computed once,
on the host, in vectorised numpy; what is no oriented surface is refused here, with the indices and the remedy.

A half-edge is one side of one face: number `3 * f + i` is the side of face `f` opposite its corner `i`.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Int


class SurfaceError(ValueError):
    """What is no oriented surface: what is wrong and where, the remedy for arrays, and the one for a file."""

    def __init__(self, fault: str, remedy: str = "", in_file: str = "", reverse: Int[np.ndarray, " n"] | None = None):
        super().__init__(f"{fault} {remedy}".strip())
        self.of_file = f"{fault} {in_file}"
        self.reverse = reverse  # the faces to reverse, where that is all


class Connectivity(NamedTuple):
    """The integer arrays of a `Mesh`; see there for what each holds."""

    edges: Int[np.ndarray, "E 2"]
    edge_faces: Int[np.ndarray, "E 2"]
    edge_corners: Int[np.ndarray, "E 2"]
    face_edges: Int[np.ndarray, "F 3"]
    twins: Int[np.ndarray, "F 3"]
    face_opposite: Int[np.ndarray, "F 3"]


def listed(indices: Iterable, limit: int = 8) -> str:
    """The first few of many indices, for an error message."""
    items = [str(i) for i in indices]
    tail = f" and {len(items) - limit} more" if len(items) > limit else ""
    return ", ".join(items[:limit]) + tail


def connect(faces: Int[np.ndarray, "F 3"], n_vertices: int) -> Connectivity:
    """Connects triangles into an oriented surface, with or without a boundary.

    **Arguments:**

    - `faces`: vertex indices, each row per cycle.
    - `n_vertices`: how many vertices there are.

    **Raises:** `ValueError` for an index out of range, a repeated corner, a repeated face, an edge of more than two
    faces, faces of opposite orientation, an unused vertex, and a vertex where the surface only touches itself.
    """
    _check_corners(faces, n_vertices)
    _check_repeats(faces)
    tails = np.roll(faces, -1, axis=1).ravel()
    heads = np.roll(faces, -2, axis=1).ravel()
    keys = np.minimum(tails, heads).astype(np.int64) * n_vertices + np.maximum(tails, heads)
    order = np.argsort(keys, kind="stable")  # stable: within an edge, faces ascend
    starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
    counts = np.diff(starts, append=len(order))
    _check_edges(tails, heads, order, starts, counts)

    first = order[starts]
    shared = counts == 2
    left, right = first[shared], order[starts[shared] + 1]
    _check_orientation(tails, heads, left, right, len(faces))
    second = np.full(len(first), -1)
    second[shared] = right

    twins = np.full(len(order), -1)
    twins[left], twins[right] = right, left
    _check_vertices(faces, twins, n_vertices)

    edge_of = np.empty(len(order), int)
    edge_of[order] = np.repeat(np.arange(len(first)), counts)
    pair = np.stack([first, second], axis=1)
    arrays = Connectivity(
        edges=np.stack([tails[first], heads[first]], axis=1),
        edge_faces=np.where(pair < 0, -1, pair // 3),
        edge_corners=np.where(pair < 0, -1, pair % 3),
        face_edges=edge_of.reshape(-1, 3),
        twins=twins.reshape(-1, 3),
        face_opposite=np.where(twins < 0, -1, faces.ravel()[twins]).reshape(-1, 3),
    )
    return Connectivity(*(array.astype(np.int32) for array in arrays))


def components(n: int, a: Int[np.ndarray, " L"], b: Int[np.ndarray, " L"]) -> tuple[int, Int[np.ndarray, " n"]]:
    """How many connected parts `n` things have that are linked in pairs `(a, b)`, and the part of each."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count, label = connected_components(coo_array((np.ones(len(a), np.int8), (a, b)), shape=(n, n)), directed=False)
    return int(count), label


def _check_corners(faces, n_vertices):
    outside = (faces < 0) | (faces >= n_vertices)
    if outside.any():
        where = np.flatnonzero(outside.any(1))
        raise SurfaceError(
            f"vertex index out of range: face {where[0]} is {faces[where[0]].tolist()}, but there are {n_vertices} "
            f"vertices, 0 to {n_vertices - 1} (faces with such an index: {listed(where)}).",
            remedy="Indices count from 0.",
            in_file="The file is not whole, or counts from elsewhere than its format does: write it anew.",
        )
    a, b, c = faces.T
    repeated = np.flatnonzero((a == b) | (b == c) | (c == a))
    if len(repeated):
        raise SurfaceError(
            f"repeated corner: face {repeated[0]} is {faces[repeated[0]].tolist()}; a face needs three different "
            f"vertices (faces with a repeated corner: {listed(repeated)}).",
            remedy="Delete these faces: they have no area.",
            in_file="They have no area: Mesh.read(path, weld=True) leaves them out.",
        )


def _check_repeats(faces):
    low, middle, high = np.sort(faces, axis=1).T
    order = np.lexsort((high, middle, low))
    corners = np.stack([low, middle, high])[:, order]
    same = (np.diff(corners) == 0).all(0)
    if same.any():
        at = int(np.argmax(same))
        raise SurfaceError(
            f"repeated face: faces {order[at]} and {order[at + 1]} both have the corners {corners[:, at].tolist()} "
            f"({int(same.sum())} such repeats in all).",
            remedy="Keep one of each.",
            in_file="Mesh.read(path, weld=True) keeps the first of each.",
        )


def _check_edges(tails, heads, order, starts, counts):
    crowded = np.flatnonzero(counts > 2)
    if len(crowded):
        sides = [order[starts[e] : starts[e] + counts[e]] for e in crowded[:3]]
        edges = "; ".join(
            f"edge ({tails[h[0]]}, {heads[h[0]]}) belongs to {len(h)} faces: {listed(h // 3)}" for h in sides
        )
        raise SurfaceError(
            f"not a surface: {edges} ({len(crowded)} such edges in all). At most two faces may share an edge:",
            remedy="delete those that are too many, or give each sheet its own copies of the edge's vertices.",
            in_file="take the others out in the program that the file comes from (walls inside a body, sheets that "
            "meet). Where it is read with weld, a smaller tolerance keeps sheets apart that only lie close.",
        )


def _check_orientation(tails, heads, left, right, n_faces):
    """Left and right are the half-edges of each inner edge; they must run along it in opposite senses."""
    clash = tails[left] == tails[right]
    if not clash.any():
        return
    at = int(np.argmax(clash))
    place = (
        f"inconsistent orientation: faces {left[at] // 3} and {right[at] // 3} both run along their common edge from "
        f"vertex {tails[left[at]]} to {heads[left[at]]} ({int(clash.sum())} such edges in all)"
    )
    # Two copies of every face, as given and reversed, linked where they agree: a part that holds both copies of a face
    # is one-sided, and otherwise the smaller of the two sets in a part is the one to reverse.
    f, g = left // 3, right // 3
    flip = np.where(clash, n_faces, 0)
    _, label = components(2 * n_faces, np.concatenate([f, f + n_faces]), np.concatenate([g + flip, g + n_faces - flip]))
    given, reversed_ = label[:n_faces], label[n_faces:]
    if (given == reversed_).any():
        cut = "No reversal of faces helps: the surface is one-sided, as a Moebius strip. Cut it open"
        raise SurfaceError(f"{place}.", remedy=f"{cut}.", in_file=f"{cut} in the program that the file comes from.")
    size = np.bincount(label[:n_faces], minlength=label.max() + 1)
    wrong = np.flatnonzero((size[given] < size[reversed_]) | ((size[given] == size[reversed_]) & (given > reversed_)))
    raise SurfaceError(
        f"{place}.",
        remedy=f"Reverse these faces, as in faces[i] = faces[i, ::-1]: {listed(wrong, 20)}.",
        in_file=f"Mesh.read(path, orient=True) reverses the {len(wrong)} that are turned the wrong way.",
        reverse=wrong,
    )


def _check_vertices(faces, twins, n_vertices):
    unused = np.flatnonzero(np.bincount(faces.ravel(), minlength=n_vertices) == 0)
    if len(unused):
        raise SurfaceError(
            f"unused vertex: no face has vertex {listed(unused)}.",
            remedy="Drop them: used, renumbered = numpy.unique(faces, return_inverse=True); vertices, faces = "
            "vertices[used], renumbered.reshape(-1, 3).",
            in_file="Mesh.read(path, drop_unused=True) leaves them out.",
        )
    # Corners of neighbouring faces at the same vertex are linked; each vertex must be one linked fan of them.
    inner = np.flatnonzero(twins >= 0)
    twin = twins[inner]
    at_tail = inner - inner % 3 + (inner + 1) % 3
    at_twin_head = twin - twin % 3 + (twin + 2) % 3
    n_fans, fan = components(len(twins), at_tail, at_twin_head)
    if n_fans > n_vertices:
        vertex_of_fan = np.empty(n_fans, int)
        vertex_of_fan[fan] = faces.ravel()
        fans = np.bincount(vertex_of_fan, minlength=n_vertices)
        pinched = np.flatnonzero(fans > 1)
        at = np.flatnonzero(faces.ravel() == pinched[0])
        examples = at[np.unique(fan[at], return_index=True)[1]] // 3
        raise SurfaceError(
            f"the surface touches itself at a point: the faces around vertex {pinched[0]} form {fans[pinched[0]]} "
            f"separate fans, one with face {' and one with face '.join(map(str, examples))} (such vertices: "
            f"{listed(pinched)}).",
            remedy="Give each fan its own copy of the vertex.",
            in_file="Take the parts apart there, in the program that the file comes from; or, where faces of several "
            "solids were joined, write each to a file of its own.",
        )
