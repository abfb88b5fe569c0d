"""The meshes of the benchmarks, as files that shellkit and a peer can both read."""

import atexit
import functools
import tempfile
from pathlib import Path


SUZANNE = Path(__file__).parent.parent / "examples" / "meshes" / "suzanne.obj"


@functools.cache
def file(name: str) -> Path:
    """The .obj file of `"icosphere-3"`, an icosahedron subdivided three times, or of `"suzanne"`; made where needed.

    Faces begin with their smallest vertex, as triangulax turns them: an angle on a face counts from its first edge.
    """
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)

    import shellkit as sk

    kind, _, level = name.partition("-")
    mesh = sk.meshes.icosphere(subdivisions=int(level)) if kind == "icosphere" else sk.Mesh.read(SUZANNE)
    turn = jnp.argmin(mesh.faces, axis=1)[:, None] + jnp.arange(3)
    path = _folder() / f"{name}.obj"
    sk.Mesh(mesh.vertices, jnp.take_along_axis(mesh.faces, turn % 3, axis=1)).write(path)
    return path


@functools.cache
def _folder() -> Path:
    folder = tempfile.TemporaryDirectory()
    atexit.register(folder.cleanup)
    return Path(folder.name)
