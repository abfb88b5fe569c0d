"""Whole problems as files: the structure as JSON, the arrays beside it in an npz file, and no code at all. A class is
named, never imported: those of shellkit and its solvers are known, others are handed over by who loads the file."""

import json
import os
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .._fit.history import FitResult
from .._programs.tracing import is_traced
from .._programs.whole_files import replaced
from .structure import Decoder, Encoder


_FORMAT, _VERSION = "shellkit problem", 1


def save(problem: Any, path: str | os.PathLike) -> Path:
    """Writes a problem with all its parts to a file, whole or not at all: mesh, thickness, energy, actuation, loss,
    supports, solver.

    The file is a numpy npz: arrays to the last bit, and the structure as JSON. It holds no code and nothing pickled,
    so that a file from a stranger can be loaded. What follows from the parts (connectivity, numbering) is not
    stored, but worked out when the problem is loaded; and where the solver is the default one of this machine, whoever
    loads the problem has theirs.

    **Arguments:**

    - `problem`: an [`shellkit.InverseProblem`][], any part of one, or the result of a fit, of which the best design is
        taken.
    - `path`: where to; the usual ending is `.npz`.

    **Returns:** the path.

    **Raises:** `ValueError` for what has no place in such a file, with where it stands: a function (other than the
    norms of optimistix, the activations of `jax.nn` and elementary functions of `jax.numpy`), a class that is defined
    within a function, an object that is no module, traced values. `FileNotFoundError` for a folder that is not there.

    ??? example

        ```python
        sk.save(result.problem, "design.npz")
        problem = sk.load("design.npz")
        ```
    """
    if isinstance(problem, FitResult):
        problem = problem.problem
    if is_traced(problem):
        raise ValueError("save: values of the problem are traced; call it outside jit, grad and vmap.")
    path = Path(path)
    if not path.parent.is_dir():
        raise FileNotFoundError(f"save: cannot write {path}: there is no folder {path.parent}; create it first.")
    encoder = Encoder()
    header = {"format": _FORMAT, "version": _VERSION, "root": encoder.encode(problem, "problem")}
    arrays = {"structure": np.frombuffer(json.dumps(header).encode(), np.uint8)}
    arrays |= {f"array_{k}": array for k, array in enumerate(encoder.arrays)}
    with replaced(path) as part, part.open("wb") as file:
        np.savez(file, **arrays)  # pyright: ignore[reportArgumentType]  # its one option is none of these names
    return path


def load(path: str | os.PathLike, classes: Sequence[type] = ()) -> Any:
    """Reads what [`shellkit.save`][] wrote: a problem that relaxes to the same energy, to the last bit.

    **Arguments:**

    - `path`: the file.
    - `classes`: classes of your own in it, such as an energy term; no others are looked for.

    **Returns:** the problem, built anew from its parts, or the part that was saved.

    **Raises:** `FileNotFoundError` if there is no such file. `ValueError` for a file of something else, one that a
    newer version of shellkit wrote, a class that is not at hand (with its name), and a class whose fields have
    changed.
    """
    path = Path(path)
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        header = json.loads(arrays.pop("structure").tobytes())
        known, newer = header["format"] == _FORMAT, header["version"] > _VERSION
    except (ValueError, KeyError, TypeError, AttributeError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"load: {path} is no file of sk.save, or damaged: {error}") from error
    if not known:
        raise ValueError(f"load: {path} holds a {header['format']!r}, which is nothing that sk.save writes.")
    if newer:
        raise ValueError(
            f"load: {path} has version {header['version']} of the format, and this shellkit knows it up to {_VERSION}: "
            "load it with a newer shellkit."
        )
    try:
        return Decoder(path, arrays, classes).decode(header["root"], "problem")
    except KeyError as error:
        raise ValueError(f"load: {path} is damaged: it lacks {error}.") from error
