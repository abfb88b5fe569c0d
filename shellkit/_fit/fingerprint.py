"""What a tree of modules is made of, as text that can be stored and compared: so that a checkpoint knows its own
problem, and can say in which part another one differs."""

import dataclasses
import hashlib
import re
from collections.abc import Iterator, Mapping
from typing import Any

import equinox as eqx
import jax
import numpy as np


Part = str | tuple[str, float, float]

# Two relaxations of one target on different machines agree to far more digits than this, two targets to fewer.
_RELATIVE = 1e-6


def describe(tree: Any, contents: bool = True) -> dict[str, Part]:
    """Each part of a tree by its path: the classes of its modules, its static values, its arrays.

    An array of integers is named by a hash of its content. One of floats is named by its norm and its product with a
    fixed vector instead, which are compared up to rounding: a target that was itself computed need not be equal bit
    for bit when a fit is taken up again. With `contents=False` only shapes and dtypes count.
    """
    return dict(_parts(tree, "", contents))


def differences(saved: Mapping[str, Any], present: Mapping[str, Any]) -> list[str]:
    """A line for each part in which two descriptions differ; the saved one may have come through JSON."""
    lines = []
    for path in sorted(saved.keys() | present.keys()):
        if path not in present:
            lines.append(f"{path}: {_text(saved[path])} in the checkpoint, absent here")
        elif path not in saved:
            lines.append(f"{path}: absent in the checkpoint, {_text(present[path])} here")
        elif not _same(saved[path], present[path]):
            before, now = _text(saved[path]), _text(present[path])
            change = f"other values ({now})" if before == now else f"{before} in the checkpoint, {now} here"
            lines.append(f"{path}: {change}")
    return lines


def _parts(node: Any, path: str, contents: bool) -> Iterator[tuple[str, Part]]:
    if isinstance(node, eqx.Module):
        yield path, type(node).__qualname__
        own = vars(node)  # not what the class gives, such as methods bound to the module itself
        children = {field.name: own[field.name] for field in dataclasses.fields(node) if field.name in own}
    elif isinstance(node, dict):
        children = {str(key): node[key] for key in sorted(node, key=str)}
    elif isinstance(node, tuple) and hasattr(node, "_fields"):
        yield path, type(node).__qualname__
        children = dict(zip(node._fields, node, strict=True))  # pyright: ignore[reportAttributeAccessIssue]
    elif isinstance(node, list | tuple):
        children = {str(place): child for place, child in enumerate(node)}
    else:
        yield path, _leaf(node, contents)
        return
    for name, child in children.items():
        yield from _parts(child, f"{path}.{name}" if path else name, contents)


def _leaf(leaf: Any, contents: bool) -> Part:
    if not eqx.is_array(leaf):
        # An address is no part of what a function is, and differs from one run to the next.
        items = sorted(map(repr, leaf)) if isinstance(leaf, set | frozenset) else repr(leaf)
        return re.sub(r" at 0x[0-9a-f]+", "", str(items))
    kind = f"{leaf.dtype}{list(leaf.shape)}"
    if not contents:
        return kind
    if jax.dtypes.issubdtype(leaf.dtype, jax.dtypes.prng_key):
        leaf = jax.random.key_data(leaf)
    array = np.asarray(leaf)
    if not np.issubdtype(array.dtype, np.inexact):
        return f"{kind} {hashlib.sha256(array.tobytes()).hexdigest()[:12]}"
    finite = np.isfinite(array)
    kind += "" if finite.all() else f" with {np.sum(~finite)} not finite"
    flat = np.where(finite, array, 0).ravel()
    return kind, float(np.linalg.norm(flat)), float(np.abs(flat @ np.cos(np.arange(flat.size))))


def _same(saved: Any, present: Any) -> bool:
    if isinstance(saved, str) or isinstance(present, str):
        return saved == present
    return saved[0] == present[0] and bool(
        np.allclose(saved[1:], present[1:], rtol=0, atol=_RELATIVE * max(saved[1], present[1]))
    )


def _text(part: Any) -> str:
    text = part if isinstance(part, str) else f"{part[0]} of norm {part[1]:.9g}"
    return text if len(text) <= 80 else f"{text[:77]}..."
