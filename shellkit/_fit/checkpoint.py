"""A file that holds a fit at one of its steps. It is replaced in one piece, so that a kill at any moment leaves either
the older or the newer one, and it names the problem it belongs to."""

import hashlib
import io
import json
import os
import re
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from .choices import check_count
from .design import split_at
from .fingerprint import describe, differences
from .history import FitResult, History


_MAGIC = b"shellkit fit checkpoint 1\n"


@dataclass(frozen=True)
class Checkpoint:
    """A file in which a fit is kept as it goes on. The same call made again takes it up from there, and goes on exactly
    as it would have without the stop.

    It is replaced atomically, so that a kill at any moment does no harm; and it is written when the fit ends, were it
    by an error. A file that is no checkpoint is never touched. `fit(…, checkpoint="run")` is short for
    `checkpoint=sk.Checkpoint("run")`.

    **Arguments:**

    - `path`: the file. Its folder is made.
    - `every`: how many steps apart it is written.

    **Raises:** `ValueError` for a number below 1.
    """

    path: str | os.PathLike
    every: int = 25

    def __post_init__(self):
        check_count("Checkpoint: every", self.every)


class Stored(NamedTuple):
    """A checkpoint that was read: its header, and the bytes of its arrays."""

    path: Path
    header: dict[str, Any]
    arrays: bytes

    def restore(self, like: Any) -> Any:
        """The arrays that were written first, in a tree of this structure (its leaves may be only shapes)."""
        try:
            return eqx.tree_deserialise_leaves(io.BytesIO(self.arrays), like, _read_leaf)
        except (RuntimeError, ValueError, EOFError) as error:
            raise ValueError(f"checkpoint {self.path} does not hold the arrays it should: {error}") from error


def write(path: Path, header: Mapping[str, Any], tree: Any) -> None:
    """Writes a checkpoint, or replaces it in one piece."""
    arrays = io.BytesIO()
    eqx.tree_serialise_leaves(arrays, tree, _write_leaf)
    payload = arrays.getvalue()
    line = json.dumps({**header, "sha256": hashlib.sha256(payload).hexdigest()})
    partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}.partial")
    try:
        with partial.open("xb") as file:
            file.write(_MAGIC + line.encode() + b"\n")
            file.write(payload)
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
    if os.name == "posix":
        # The new name is on the disk only once the folder is.
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def read(path: Path) -> Stored:
    """Reads a checkpoint. A `ValueError` says if the file is something else, or damaged."""
    with path.open("rb") as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise ValueError(
                f"{path} exists and is not a checkpoint of this version of shellkit: it is left untouched. "
                "Give another path, or move the file away."
            )
        line, arrays = file.readline(), file.read()
    try:
        header = json.loads(line)
        sound = header["sha256"] == hashlib.sha256(arrays).hexdigest()
    except (ValueError, KeyError, TypeError):
        sound = False
    if not sound:
        raise ValueError(f"checkpoint {path} is damaged: its content is not what was written. Delete it or restore it.")
    return Stored(path, header, arrays)


def prepare(path: str | os.PathLike) -> Path:
    """The path of a checkpoint to be: its folder made, what a killed run left half-written there removed."""
    path = Path(path)
    if path.is_dir():
        raise ValueError(f"checkpoint {path} is a folder: give the path of a file, such as {path / 'run'}.")
    path.parent.mkdir(parents=True, exist_ok=True)
    half_written = re.compile(rf"\.{re.escape(path.name)}\.[0-9a-f]{{8}}\.partial")
    for file in path.parent.iterdir():
        if half_written.fullmatch(file.name):
            file.unlink(missing_ok=True)
    return path


def belongs(stored: Stored, fingerprint: Mapping[str, Any]) -> None:
    """Raises a `ValueError` that says what differs unless a checkpoint has this fingerprint."""
    lines = [
        line
        for group, parts in fingerprint.items()
        for line in differences(_prefixed(group, stored.header["fingerprint"][group]), _prefixed(group, parts))
    ]
    if lines:
        more = f"\n  and {len(lines) - 8} more" if len(lines) > 8 else ""
        raise ValueError(
            f"checkpoint {stored.path} belongs to another fit, which differs in\n  "
            + "\n  ".join(lines[:8])
            + more
            + "\nTo resume, pass the problem, optimiser and choices it was begun with (not the result of that fit); to "
            "begin anew, give another checkpoint path or delete the file."
        )


def load_checkpoint(path: str | os.PathLike, like: Any) -> FitResult:
    """Reads the result so far from a checkpoint of [`shellkit.fit`][], without resuming the fit.

    To go on with the fit, call `fit` again with the same arguments and the same `checkpoint=`.

    **Arguments:**

    - `path`: the file.
    - `like`: the problem the fit began with, or any of its designs: the values of its trained arrays do not matter, the
        rest must be the same.

    **Returns:** a [`shellkit.FitResult`][] with the best and the last design, the history and why the fit had stopped
    (`"running"` if it was killed). Its `equilibrium` and `state` are `None`.

    **Raises:** `FileNotFoundError` if there is no such file; `ValueError` if the file is no checkpoint, is damaged, or
    belongs to another problem (the message says in which parts).
    """
    stored = read(Path(path))
    names = stored.header["names"]
    design, values = split_at(like, names)
    trained = {name: f"{x.dtype}{list(x.shape)}" for name, x in values.items()}
    belongs(stored, {"problem": describe(design.frozen), "trained": trained})
    best, last = stored.restore((values, values))
    return FitResult(
        problem=design.problem(best),
        best_loss=stored.header["best_loss"],
        best_step=stored.header["best_step"],
        equilibrium=None,
        last_problem=design.problem(last),
        history=History(stored.header["history"]),
        stopped=stored.header["stopped"],
        state=None,
    )


def _prefixed(group: str, parts: Mapping[str, Any]) -> dict[str, Any]:
    return {f"{group}.{path}" if path else group: part for path, part in parts.items()}


def _write_leaf(file: Any, leaf: Any) -> None:
    eqx.default_serialise_filter_spec(file, jax.random.key_data(leaf) if _is_key(leaf) else leaf)


def _read_leaf(file: Any, leaf: Any) -> Any:
    if _is_key(leaf):
        return jax.random.wrap_key_data(jnp.load(file), impl=jax.random.key_impl(leaf))
    return eqx.default_deserialise_filter_spec(file, leaf)


def _is_key(leaf: Any) -> bool:
    return isinstance(leaf, jax.Array) and jax.dtypes.issubdtype(leaf.dtype, jax.dtypes.prng_key)
