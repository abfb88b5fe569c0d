"""Make ``suzanne.obj``: Blender's monkey head as one clean closed triangle mesh.

Blender's own Suzanne has 507 vertices in three open pieces (the head and two eyes), which is no use as a rest surface.
This script turns it into a closed genus-0 mesh with well-shaped triangles, in two steps that run in two environments,
so that bpy (GPL, Python 3.11, numpy < 2) stays apart from everything else:

1. ``dump`` (needs bpy): add the monkey primitive, round it with two levels of Catmull-Clark subdivision and write the
   still open pieces as vertices and triangles to an ``.npz`` file;
2. ``remesh`` (needs numpy, scipy, libigl, scikit-image, pyvista, pyacvd): signed distance by winding number on a grid,
   contour, Taubin smoothing, uniform remeshing, then Delaunay flips and tangential relaxation, and a little mean
   curvature flow; check and write the obj.

Set the two environments up once::

    python3.11 -m venv venv-bpy  && venv-bpy/bin/pip install "bpy==4.5.15" "numpy<2"
    python3.11 -m venv venv-mesh && venv-mesh/bin/pip install numpy scipy libigl scikit-image pyvista pyacvd

and run both steps with one command from the second one (about 15 seconds)::

    venv-mesh/bin/python make_suzanne.py --bpy-python venv-bpy/bin/python

Without ``--bpy-python``, ``--raw FILE.npz`` starts from an earlier dump. ``--round FILE.obj`` does the last step alone,
with the head as it was before it, and needs numpy and scipy; ``--check FILE.obj`` only measures a mesh and needs numpy.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np


HERE = Path(__file__).resolve().parent

GRID = 0.02  # spacing of the distance grid, in Blender units (the head is 2.73 wide)
OFFSET = 0.03  # level of the contour: a little outside, so that the rims of the thin ears turn less sharply
TAUBIN = {"n_iter": 100, "pass_band": 0.03}
SUBDIVISIONS = 2  # levels of Catmull-Clark in Blender
FLOW, FLOW_STEPS = 0.002, 5  # time of the mean curvature flow, in units of the squared rms radius
VERTICES = 1400  # clusters asked of the uniform remeshing
MIN_ANGLE, MAX_ANGLE = 25.0, 115.0  # accepted corner angles, in degrees


# ---------------------------------------------------------------------------------------------- step 1, in Blender


def dump_raw(path: Path) -> None:
    """Write Blender's monkey (size 2, at the origin, subdivided) as ``vertices`` and ``faces``. Needs bpy."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_monkey_add(size=2.0, location=(0.0, 0.0, 0.0))
    monkey = bpy.context.object
    monkey.modifiers.new("subdivision", "SUBSURF").levels = SUBDIVISIONS
    evaluated = monkey.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    mesh.calc_loop_triangles()
    vertices = np.empty(3 * len(mesh.vertices))
    faces = np.empty(3 * len(mesh.loop_triangles), dtype=np.int32)
    mesh.vertices.foreach_get("co", vertices)
    mesh.loop_triangles.foreach_get("vertices", faces)
    np.savez(path, vertices=vertices.reshape(-1, 3), faces=faces.reshape(-1, 3))


# ---------------------------------------------------------------------------------------------- measures of a mesh


def corner_angles(x: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Corner angles in degrees, shape (faces, 3)."""
    p = x[faces]
    a, b = np.roll(p, -1, axis=1) - p, np.roll(p, 1, axis=1) - p
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1)))


def face_normals(x: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals of the faces."""
    p = x[faces]
    n = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def volume(x: np.ndarray, faces: np.ndarray) -> float:
    """Signed volume of a closed mesh: positive when the normals point outwards."""
    p = x[faces]
    return float(np.sum(p[:, 0] * np.cross(p[:, 1], p[:, 2])) / 6.0)


def half_edges(faces: np.ndarray) -> np.ndarray:
    """Directed edges, shape (3 faces, 2); half edge 3 f + c runs from corner c of face f to the next corner."""
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)


def opposite_half_edges(faces: np.ndarray) -> np.ndarray:
    """For each half edge, the one that runs the other way; raises if the mesh is not closed, manifold and oriented."""
    he = half_edges(faces).astype(np.int64)
    n = int(faces.max()) + 1
    key, back = he[:, 0] * n + he[:, 1], he[:, 1] * n + he[:, 0]
    order = np.argsort(key)
    if np.any(np.diff(key[order]) == 0):
        raise ValueError("an oriented edge occurs twice: not manifold, or not consistently oriented")
    at = order[np.minimum(np.searchsorted(key, back, sorter=order), len(key) - 1)]
    if not np.array_equal(key[at], back):
        raise ValueError("an edge has a face on one side only: not closed, or not consistently oriented")
    return at


def count_components(edges: np.ndarray, n: int) -> int:
    """Number of connected components of a graph on n vertices."""
    label = np.arange(n)
    while True:
        new = label.copy()
        np.minimum.at(new, edges[:, 0], label[edges[:, 1]])
        np.minimum.at(new, edges[:, 1], label[edges[:, 0]])
        new = new[new]
        if np.array_equal(new, label):
            return len(np.unique(label))
        label = new


def fans_are_whole(faces: np.ndarray) -> bool:
    """Whether the faces around each vertex form a single fan (no two surfaces touching at a vertex)."""
    twin = opposite_half_edges(faces)
    corner = np.arange(faces.size)
    turn = twin[3 * (corner // 3) + (corner + 2) % 3]  # same vertex, next face around it
    return count_components(np.stack([corner, turn], axis=1), faces.size) == len(np.unique(faces))


def self_intersections(x: np.ndarray, faces: np.ndarray) -> int:
    """Number of pairs of faces that cut each other.

    Every pair with overlapping boxes is tested, edges of one against the inside of the other, except for edges that
    share a vertex with the other face. Faces that share an edge can only overlap by folding flat, which the largest
    dihedral angle shows.
    """
    p = x[faces]
    low, high = p.min(axis=1), p.max(axis=1)
    pairs = []
    for f in range(len(faces) - 1):
        hit = np.all((low[f] <= high[f + 1 :]) & (low[f + 1 :] <= high[f]), axis=1)
        other = f + 1 + np.nonzero(hit)[0]
        pairs.append(np.stack([np.full(len(other), f), other], axis=1))
    pair = np.concatenate(pairs)
    cut = np.zeros(len(pair), dtype=bool)
    for one, two in ((pair[:, 0], pair[:, 1]), (pair[:, 1], pair[:, 0])):
        a, u, v = p[two, 0], p[two, 1] - p[two, 0], p[two, 2] - p[two, 0]
        for c in range(3):
            ends = faces[one][:, [c, (c + 1) % 3]]
            free = ~np.any(ends[:, :, None] == faces[two][:, None, :], axis=(1, 2))
            start, ray = x[ends[:, 0]], x[ends[:, 1]] - x[ends[:, 0]]
            h = np.cross(ray, v)
            det = np.sum(u * h, axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                s = start - a
                q = np.cross(s, u)
                b1, b2, t = (np.sum(m * n, axis=1) / det for m, n in ((s, h), (ray, q), (v, q)))
                cut |= free & (b1 >= 0) & (b2 >= 0) & (b1 + b2 <= 1) & (t >= 0) & (t <= 1)
    return int(cut.sum())


def measure(x: np.ndarray, faces: np.ndarray) -> dict[str, float]:
    """Figures of a closed mesh; raises if it is not closed, manifold and consistently oriented."""
    twin = opposite_half_edges(faces)
    if not fans_are_whole(faces):
        raise ValueError("a vertex joins two fans of faces")
    n = face_normals(x, faces)
    left, right = n[np.arange(faces.size) // 3], n[twin // 3]
    bend = np.degrees(np.arctan2(np.linalg.norm(np.cross(left, right), axis=1), np.sum(left * right, axis=1)))
    edges = half_edges(faces)
    length = np.linalg.norm(x[edges[:, 1]] - x[edges[:, 0]], axis=1)
    angle = corner_angles(x, faces)
    valence = np.bincount(faces.ravel(), minlength=len(x))
    return {
        "vertices": len(x),
        "faces": len(faces),
        "unused vertices": int(np.sum(valence == 0)),
        "duplicate vertices": len(x) - len(np.unique(np.round(x, 9), axis=0)),
        "components": count_components(edges, len(x)),
        "genus": (2 - (len(x) - faces.size // 2 + len(faces))) // 2,
        "volume": volume(x, faces),
        "smallest angle": float(angle.min()),
        "largest angle": float(angle.max()),
        "largest dihedral (normal to normal)": float(bend.max()),
        "99th percentile of the dihedrals": float(np.percentile(bend, 99)),
        "median dihedral": float(np.median(bend)),
        "shortest edge": float(length.min()),
        "mean edge": float(length.mean()),
        "longest edge": float(length.max()),
        "smallest valence": int(valence.min()),
        "largest valence": int(valence.max()),
        "self-intersections": self_intersections(x, faces),
        "vertex mean (norm)": float(np.linalg.norm(x.mean(axis=0))),
        "rms radius": float(np.sqrt(np.mean(np.sum(x**2, axis=1)))),
    }


def failures(figures: dict[str, float]) -> list[str]:
    """What the figures of the finished mesh fail to meet."""
    wanted = {
        "one component": figures["components"] == 1,
        "genus 0": figures["genus"] == 0,
        "no unused vertices": figures["unused vertices"] == 0,
        "no duplicate vertices": figures["duplicate vertices"] == 0,
        "outward orientation": figures["volume"] > 0,
        "smallest angle": figures["smallest angle"] >= MIN_ANGLE,
        "largest angle": figures["largest angle"] <= MAX_ANGLE,
        "no self-intersection": figures["self-intersections"] == 0,
        "centred": figures["vertex mean (norm)"] < 1e-7,
        "rms radius 1": abs(figures["rms radius"] - 1.0) < 1e-7,
    }
    return [name for name, met in wanted.items() if not met]


# ---------------------------------------------------------------------------------------------- step 2, remeshing


def closed_surface(x: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Outer closed surface around an open triangle soup: contour of the distance signed by winding number."""
    import igl
    import pyvista as pv
    from skimage.measure import marching_cubes

    low = x.min(axis=0) - 4 * GRID
    shape = np.ceil((np.ptp(x, axis=0) + 8 * GRID) / GRID).astype(int) + 1
    points = low + GRID * np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 3)
    sign = igl.SignedDistanceType.SIGNED_DISTANCE_TYPE_WINDING_NUMBER
    distance = np.asarray(igl.signed_distance(points, x, faces.astype(np.int64), sign_type=sign)[0])
    verts, tris, _, _ = marching_cubes(distance.reshape(shape), level=OFFSET, spacing=(GRID,) * 3)
    # the largest component is the outside; smaller ones line cavities behind the eyes
    surface = pv.PolyData.from_regular_faces(verts + low, tris).clean().connectivity("largest").clean()
    surface = surface.smooth_taubin(**TAUBIN)
    tris = surface.regular_faces.astype(np.int64)
    verts = np.asarray(surface.points, dtype=float)
    return verts, tris if volume(verts, tris) > 0 else tris[:, ::-1]


def uniform_mesh(x: np.ndarray, faces: np.ndarray, clusters: int) -> tuple[np.ndarray, np.ndarray]:
    """Remesh to about ``clusters`` vertices with pyacvd, oriented outwards."""
    import pyacvd
    import pyvista as pv

    clustering = pyacvd.Clustering(pv.PolyData.from_regular_faces(x, faces))
    clustering.cluster(clusters)
    mesh = clustering.create_mesh()
    tris, verts = mesh.regular_faces.astype(np.int64), np.asarray(mesh.points, dtype=float)
    return verts, tris if volume(verts, tris) > 0 else tris[:, ::-1]


def flip_to_delaunay(x: np.ndarray, faces: np.ndarray, max_bend: float = 60.0) -> tuple[np.ndarray, int]:
    """Flip edges whose opposite angles sum to more than 180 degrees; returns the faces and the number of flips.

    An edge is left alone where the flip would double an edge, leave a vertex with fewer than four neighbours, or turn
    one of the two normals by more than ``max_bend`` degrees.
    """
    faces = faces.copy()
    flips = 0
    for _ in range(20):
        twin, angle = opposite_half_edges(faces), corner_angles(x, faces)
        valence = np.bincount(faces.ravel(), minlength=len(x))
        edges = {tuple(e) for e in half_edges(faces).tolist()}
        facing = np.roll(angle, -2, axis=1).ravel()  # the angle that looks at each half edge
        total = facing + facing[twin]
        touched: set[int] = set()
        before = flips
        for h in np.argsort(-total):
            f, g = divmod(int(h), 3), divmod(int(twin[h]), 3)
            if total[h] <= 180.0 + 1e-9:
                break
            if f[0] in touched or g[0] in touched:
                continue
            a, b, c = (int(faces[f[0], (f[1] + k) % 3]) for k in range(3))
            d = int(faces[g[0], (g[1] + 2) % 3])
            if (c, d) in edges or (d, c) in edges or min(valence[a], valence[b]) < 5:
                continue
            new = np.array([[c, d, b], [d, c, a]])
            old_normal = face_normals(x, faces[[f[0], g[0]]]).sum(axis=0)
            old_normal /= np.linalg.norm(old_normal)
            if np.any(face_normals(x, new) @ old_normal < np.cos(np.radians(max_bend))):
                continue
            faces[f[0]], faces[g[0]] = new
            edges -= {(a, b), (b, a)}
            edges |= {(c, d), (d, c)}
            valence[[a, b]] -= 1
            valence[[c, d]] += 1
            touched |= {f[0], g[0]}
            flips += 1
        if flips == before:
            break
    return faces, flips


def relax(x: np.ndarray, faces: np.ndarray, target: tuple[np.ndarray, np.ndarray], step: float = 0.5) -> np.ndarray:
    """Move each vertex along the surface towards the area-weighted mean of its faces' centres, then back onto it."""
    import igl

    p = x[faces]
    doubled = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    area = np.linalg.norm(doubled, axis=1)
    centre, weight, normal = np.zeros_like(x), np.zeros(len(x)), np.zeros_like(x)
    for c in range(3):
        np.add.at(centre, faces[:, c], area[:, None] * p.mean(axis=1))
        np.add.at(weight, faces[:, c], area)
        np.add.at(normal, faces[:, c], doubled)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    shift = centre / weight[:, None] - x
    shift -= normal * np.sum(shift * normal, axis=1, keepdims=True)
    return np.asarray(igl.point_mesh_squared_distance(x + step * shift, target[0], target[1])[2])


def normalise(x: np.ndarray) -> np.ndarray:
    """Centre at the vertex mean and scale to rms radius 1; no rotation."""
    x = x - x.mean(axis=0)
    return x / np.sqrt(np.mean(np.sum(x**2, axis=1)))


def rounded(x: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Mean curvature flow by implicit steps (M. Desbrun et al., SIGGRAPH 1999): features much smaller than the root of
    the time, a few hundredths, go away, here the edges of the ears' rims."""
    from scipy.sparse import csc_array, diags_array
    from scipy.sparse.linalg import spsolve

    n = len(x)
    for _ in range(FLOW_STEPS):
        cotangents = 1 / np.tan(np.radians(corner_angles(x, faces)))
        i, j = np.roll(faces, -1, axis=1).ravel(), np.roll(faces, 1, axis=1).ravel()
        half = csc_array((cotangents.ravel() / 2, (i, j)), shape=(n, n))
        weights = half + half.T
        p = x[faces]
        areas = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1) / 2
        mass = diags_array(np.bincount(faces.ravel(), np.repeat(areas / 3, 3), n))
        stiffness = diags_array(weights.sum(axis=1)) - weights
        x = np.asarray(spsolve(csc_array(mass + FLOW / FLOW_STEPS * stiffness), mass @ x))
    return normalise(x)


def remesh(raw: Path, clusters: int = VERTICES, rounds: int = 30) -> tuple[np.ndarray, np.ndarray]:
    """Closed, uniform, smooth mesh of the head that ``dump_raw`` wrote."""
    with np.load(raw) as data:
        soup = data["vertices"], data["faces"]
    target = closed_surface(*soup)
    x, faces = uniform_mesh(*target, clusters)
    for _ in range(rounds):
        faces, _ = flip_to_delaunay(x, faces)
        x = relax(x, faces, target)
    faces, _ = flip_to_delaunay(x, faces)
    return rounded(normalise(x), faces), faces


# ---------------------------------------------------------------------------------------------- files


def write_obj(path: Path, x: np.ndarray, faces: np.ndarray) -> None:
    """Write a Wavefront obj with nine decimals (the coordinates are of order one)."""
    lines = ["# Suzanne, Blender's monkey head, remeshed as one closed surface by make_suzanne.py"]
    lines += ["# z up, face towards -y; vertex mean 0, rms radius 1"]
    lines += ["v " + " ".join(f"{c:.9f}" for c in v) for v in x]
    lines += ["f " + " ".join(str(i + 1) for i in f) for f in faces]
    path.write_text("\n".join(lines) + "\n")


def read_obj(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read a plain triangle obj (``v x y z`` and ``f i j k`` lines)."""
    rows = [line.split() for line in path.read_text().splitlines()]
    x = np.array([[float(c) for c in r[1:4]] for r in rows if r and r[0] == "v"])
    faces = np.array([[int(c.split("/")[0]) - 1 for c in r[1:4]] for r in rows if r and r[0] == "f"])
    return x, faces


def report(path: Path) -> int:
    """Print the figures of a finished obj; 1 if it fails a check, else 0."""
    figures = measure(*read_obj(path))
    for name, value in figures.items():
        print(f"{name:38s} {value:.6g}")
    failed = failures(figures)
    print("failed: " + ", ".join(failed) if failed else "all checks met")
    return int(bool(failed))


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bpy-python", type=Path, help="Python of the environment that has bpy")
    parser.add_argument("--raw", type=Path, help="raw head written earlier with --dump")
    parser.add_argument("--out", type=Path, default=HERE / "suzanne.obj", help="obj to write (default: beside this)")
    parser.add_argument("--dump", type=Path, help="only write the raw head to this .npz; run it with bpy's Python")
    parser.add_argument("--round", type=Path, help="an obj of the head before the last step, which alone is done")
    parser.add_argument("--check", type=Path, help="only measure this obj")
    args = parser.parse_args()
    if args.dump:
        dump_raw(args.dump)
        return 0
    if args.check:
        return report(args.check)
    if args.round:
        x, faces = read_obj(args.round)
        write_obj(args.out, rounded(x, faces), faces)
        return report(args.out)
    if not (args.bpy_python or args.raw):
        parser.error("give --bpy-python (or --raw, a dump made earlier)")
    with tempfile.TemporaryDirectory() as folder:
        raw = args.raw or Path(folder) / "raw.npz"
        if not args.raw:
            subprocess.run([args.bpy_python, __file__, "--dump", raw], check=True)
        write_obj(args.out, *remesh(raw))
    return report(args.out)


if __name__ == "__main__":
    sys.exit(main())
