"""Trees of modules as JSON with numbered arrays, and back. Values of Python stand for themselves; all else is a
dictionary whose key `"is"` says what."""

import dataclasses
import math
import sys
import types
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._mesh.mesh import Mesh
from .._problem.problem import InverseProblem
from .._problem.states import States
from .._programs.tracing import known
from .._solve.newton.newton import SparseNewton


# Packages whose modules are known by name: of the last one, layers of networks only.
_PACKAGES = ("shellkit", "optimistix", "lineax", "equinox.nn")
# Built anew from these parts: what follows from them is not stored.
_BUILT: dict[type, tuple[str, ...]] = {
    Mesh: ("vertices", "faces", "vertex_data", "face_data"),
    InverseProblem: (
        *("mesh", "thickness", "energy", "actuation", "loss", "solver", "max_steps", "supports", "rest_lengths"),
    ),
    States: ("states", "shared", "weights", "after"),
}
_ELEMENTARY = ("abs", "cos", "exp", "log", "sin", "sqrt", "square", "tanh")


def _functions() -> dict[str, Callable]:
    """The functions that a file may name: none of them does more than count."""
    found = {f"jax.nn:{name}": value for name, value in vars(jax.nn).items() if callable(value) and name[0] != "_"}
    found |= {f"jax.numpy:{name}": getattr(jnp, name) for name in _ELEMENTARY}
    # Fields of minimisers: norms, and what prints.
    for module in [module for name, module in sys.modules.items() if f"{name}.".startswith("optimistix.")]:
        own = {name: value for name, value in vars(module).items() if isinstance(value, types.FunctionType)}
        found |= {f"optimistix:{name}": f for name, f in own.items() if f"{f.__module__}.".startswith("optimistix.")}
    return found


def _subclasses(cls: type) -> Iterator[type]:
    for each in cls.__subclasses__():
        yield each
        yield from _subclasses(each)


def _package(cls: type) -> str | None:
    """The package that a class is known in; None for one of somebody else's, or one that cannot be reached by name."""
    found = [package for package in _PACKAGES if f"{cls.__module__}.".startswith(f"{package}.")]
    reachable = getattr(sys.modules.get(cls.__module__), cls.__qualname__, None) is cls
    return found[0] if found and reachable else None


def known_classes() -> dict[str, type]:
    """The modules of shellkit and of the packages it builds upon, by package and name: where a class stands in its
    package may change."""
    found: dict[str, type] = {}
    for cls in set(_subclasses(eqx.Module)):
        package = _package(cls)
        if package is not None:
            found[f"{package}:{cls.__qualname__}"] = cls
    return found


class Encoder:
    """Turns a tree into what JSON can hold, and gathers its arrays; one that stands in several places is kept once."""

    def __init__(self):
        self.arrays: list[np.ndarray] = []
        self._numbers: dict[int, int] = {}
        self._kept: list[Any] = []  # so that no identity is used twice
        self._functions = {id(function): name for name, function in _functions().items()}

    def encode(self, node: Any, place: str) -> Any:
        """What JSON can hold of a node; `place` is its name in messages."""
        if node is None or isinstance(node, (bool, int, str)):
            return node
        if isinstance(node, float):
            return node if math.isfinite(node) else {"is": "float", "value": repr(node)}
        if isinstance(node, (jax.Array, np.ndarray, np.generic)):
            return self._array(node, place)
        if isinstance(node, bytes):
            return {"is": "bytes", "value": node.hex()}
        if type(node) in (list, tuple):
            items = [self.encode(item, f"{place}[{k}]") for k, item in enumerate(node)]
            return {"is": type(node).__name__, "items": items}
        if type(node) in (set, frozenset):
            return {"is": type(node).__name__, "items": [self.encode(item, place) for item in sorted(node, key=repr)]}
        if type(node) is dict and all(isinstance(key, str) for key in node):
            return {"is": "dict", "items": {key: self.encode(item, f"{place}[{key!r}]") for key, item in node.items()}}
        if isinstance(node, eqx.Module):
            return self._module(node, place)
        if id(node) in self._functions:
            return {"is": "function", "name": self._functions[id(node)]}
        if callable(node):
            name = getattr(node, "__qualname__", repr(node))
            raise ValueError(
                f"save: {place} is the function {name}, and a function cannot be stored. Give the arrays that it "
                "returns, or make it an equinox.Module with a __call__, which is loaded with classes=[...]."
            )
        raise ValueError(
            f"save: {place} is a {type(node).__name__}, which cannot be stored. Parts of a problem are arrays, "
            "numbers, texts, equinox.Modules, and lists, tuples and dictionaries of these."
        )

    def _array(self, array: Any, place: str) -> dict[str, Any]:
        if isinstance(array, jax.Array) and jax.dtypes.issubdtype(array.dtype, jax.dtypes.prng_key):
            kind = str(jax.random.key_impl(array))
            return {"is": "key", "kind": kind, "data": self._array(jax.random.key_data(array), place)}
        which = "number" if isinstance(array, np.generic) else "numpy"
        which = "jax" if isinstance(array, jax.Array) else which
        values = np.asarray(array)
        if values.dtype.kind not in "biufc":
            raise ValueError(f"save: {place} is an array of type {values.dtype}; numbers and flags can be stored.")
        if id(array) not in self._numbers:
            self._numbers[id(array)] = len(self.arrays)
            self._kept.append(array)
            self.arrays.append(values)
        return {"is": which, "array": self._numbers[id(array)]}

    def _module(self, module: eqx.Module, place: str) -> dict[str, Any]:
        cls = type(module)
        if "<locals>" in cls.__qualname__:
            raise ValueError(
                f"save: {place} is a {cls.__name__}, a class that is defined within a function, where load could not "
                "tell it from others; define it at the top of a file."
            )
        own = vars(module)
        names = _BUILT.get(cls) or [field.name for field in dataclasses.fields(module) if field.name in own]
        if cls is InverseProblem and eqx.tree_equal(own["solver"], SparseNewton()) is True:
            own = {**own, "solver": None}
        package = _package(cls)
        return {
            "is": "module",
            "class": f"{cls.__module__ if package is None else package}:{cls.__qualname__}",
            "fields": {name: self.encode(own[name], f"{place}.{name}") for name in names},
        }


class Decoder:
    """Turns what an `Encoder` made into a tree again."""

    def __init__(self, path: Path, arrays: dict[str, np.ndarray], classes: Sequence[type]):
        self._path = path
        self._arrays = arrays
        self._made: dict[tuple[str, int], Any] = {}
        self._known = known_classes()
        self._given = {f"{cls.__module__}:{cls.__qualname__}": cls for cls in classes}
        self._functions = _functions()

    def decode(self, node: Any, place: str) -> Any:
        """The node; `place` is its name in messages."""
        if not isinstance(node, dict):
            return node
        kind = node["is"]
        if kind in ("jax", "numpy", "number"):
            return self._array(kind, node["array"])
        if kind == "key":
            return jax.random.wrap_key_data(self.decode(node["data"], place), impl=node["kind"])
        if kind == "float":
            return float(node["value"])
        if kind == "bytes":
            return bytes.fromhex(node["value"])
        if kind == "dict":
            return {name: self.decode(item, f"{place}[{name!r}]") for name, item in node["items"].items()}
        if kind in ("list", "tuple", "set", "frozenset"):
            make = {"list": list, "tuple": tuple, "set": set, "frozenset": frozenset}[kind]
            return make(self.decode(item, f"{place}[{k}]") for k, item in enumerate(node["items"]))
        if kind == "function" and node["name"] in self._functions:
            return self._functions[node["name"]]
        if kind == "module":
            return self._module(node, place)
        raise ValueError(f"load: {self._path}: {place} is a {kind} {node.get('name', '')}, which is not known here.")

    def _array(self, kind: str, number: int) -> Any:
        if (kind, number) not in self._made:
            values = self._arrays[f"array_{number}"]
            made = {"jax": known, "numpy": lambda v: v, "number": lambda v: v[()]}[kind](values)
            self._made[kind, number] = made
        return self._made[kind, number]

    def _class(self, name: str, place: str) -> type:
        if name in self._known:
            return self._known[name]
        if name in self._given:
            return self._given[name]
        module, _, bare = name.partition(":")
        # A script's classes have another module when they are imported.
        alike = [cls for cls in self._given.values() if cls.__qualname__ == bare]
        if len(alike) == 1:
            return alike[0]
        remedy = f"import it and give it: sk.load(path, classes=[{bare}])."
        if module in _PACKAGES:
            remedy = f"the {module} installed here does not have it; it has another version than the one that saved it."
        raise ValueError(f"load: {self._path}: {place} is a {bare} of {module}, whose class is not at hand: {remedy}")

    def _module(self, node: dict[str, Any], place: str) -> Any:
        cls = self._class(node["class"], place)
        if not (isinstance(cls, type) and issubclass(cls, eqx.Module)):
            raise ValueError(f"load: {cls!r} is no class of modules; give classes that inherit from equinox.Module.")
        values = {name: self.decode(item, f"{place}.{name}") for name, item in node["fields"].items()}
        if cls in _BUILT:
            return cls(**values)
        fields = {field.name: field for field in dataclasses.fields(cls)}
        for name, field in fields.items():
            if name not in values and field.default is not dataclasses.MISSING:
                values[name] = field.default  # a field that came later
        if values.keys() != fields.keys():
            raise ValueError(
                f"load: {self._path}: {place} was saved as a {cls.__name__} with the fields {', '.join(values)}, and "
                f"this {cls.__name__} has {', '.join(fields)}: load it with the version that saved it."
            )
        module = object.__new__(cls)  # the values were checked when they were first given
        for name, value in values.items():
            object.__setattr__(module, name, value)
        return module
