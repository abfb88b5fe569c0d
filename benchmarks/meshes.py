"""The meshes of the benchmarks, as files that shellkit and a peer can both read."""

import atexit
import functools
import tempfile
from pathlib import Path


SUZANNE = Path(__file__).parent.parent / "examples" / "meshes" / "suzanne.obj"


@functools.cache
def file(name: str) -> Path:
    """The .obj file of `"icosphere-3"`, an icosahedron subdivided three times, of `"suzanne"`, or of `"sheet-J16"`, the
    unit square in 16 x 16 cells of the kind J of `validation.meshes`; made where needed.

    Faces begin with their smallest vertex, as triangulax turns them: an angle on a face counts from its first edge.
    """
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)

    import shellkit as sk
    from validation.meshes import KINDS, sheet

    kind, _, level = name.partition("-")
    if kind == "icosphere":
        mesh = sk.meshes.icosphere(subdivisions=int(level))
    elif kind == "sheet":
        triangles, cells = next(kind for kind in KINDS if kind == level[0]), int(level[1:])
        mesh = sheet(triangles, (cells, cells))
    else:
        mesh = sk.Mesh.read(SUZANNE)
    turn = jnp.argmin(mesh.faces, axis=1)[:, None] + jnp.arange(3)
    path = _folder() / f"{name}.obj"
    sk.Mesh(mesh.vertices, jnp.take_along_axis(mesh.faces, turn % 3, axis=1)).write(path)
    return path


@functools.cache
def _folder() -> Path:
    folder = tempfile.TemporaryDirectory()
    atexit.register(folder.cleanup)
    return Path(folder.name)
