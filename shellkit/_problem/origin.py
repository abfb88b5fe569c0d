"""What the numbering of a problem was made from, so that a part swapped afterwards is noticed: never a wrong number."""

import hashlib
from collections import OrderedDict
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, UInt32

from .._energy import AbstractEnergy, Terms
from .._mesh.mesh import Mesh
from .._programs.tracing import is_traced, known
from .._relaxation.rigid_modes import count_rigid_modes
from .._supports import Supports


_REMEMBERED = 32

# What was found in order lately, by the identity of the arrays, which are kept alive as long.
_passed: OrderedDict[Any, Any] = OrderedDict()


class Origin(eqx.Module):
    """The kinds of terms and supports, the contents of what names vertices (connectivity, stencils, selections), and
    how many rigid motions the supports leave free at most."""

    contents: UInt32[Array, "4"]
    kind: tuple = eqx.field(static=True)
    most_rigid_modes: int = eqx.field(static=True)

    @classmethod
    def of(cls, mesh: Mesh, energy: AbstractEnergy, supports: Supports | None) -> "Origin":
        """What these parts are; connectivity and selections must be known."""
        motions = count_rigid_modes(mesh, supports, Terms.of(energy).bends)
        return cls(known(_contents(mesh, energy, supports)), _kind(mesh, energy, supports), motions)

    def check(self, mesh: Mesh, energy: AbstractEnergy, supports: Supports | None) -> None:
        """Refuse parts that differ from these in more than their numbers, and supports whose numbers now contradict
        each other or set the shell free.

        Where they are traced, kinds and sizes are compared; neither what names vertices is looked at, nor where
        supports hold them.
        """
        leaves, structure = jax.tree.flatten((mesh, energy, supports))
        naming = [leaf for leaf in leaves if _names_vertices(leaf)]
        placing = [] if supports is None else jax.tree.leaves((mesh.vertices, supports))
        placing = [] if is_traced(placing) else placing
        traced = is_traced((naming, self.contents))
        key = (structure, self.kind, id(self.contents), *map(id, naming), *map(id, placing))
        if not traced and key in _passed:
            return
        kind = _kind(mesh, energy, supports)
        for name, now, then in zip(("mesh", "energy", "supports"), kind, self.kind, strict=True):
            if now != then:
                raise ValueError(
                    f"The {name} of this InverseProblem was swapped for another kind: it was built for {_said(then)}, "
                    f"and now has {_said(now)}. Build it anew: problem.replace({name}=...)."
                )
        if traced:
            return
        if not np.array_equal(_contents(mesh, energy, supports), np.asarray(self.contents)):
            raise ValueError(
                "The mesh, energy or supports of this InverseProblem now name other vertices than those that it was "
                "built for (connectivity, stencils or selections were changed). Build it anew: problem.replace(mesh="
                "..., energy=..., supports=...)."
            )
        if supports is not None and placing:
            self._check_supports(mesh, energy, supports)
        _passed[key] = (naming, placing, self.contents)
        while len(_passed) > _REMEMBERED:
            _passed.popitem(last=False)

    def _check_supports(self, mesh: Mesh, energy: AbstractEnergy, supports: Supports) -> None:
        supports.check(mesh)
        motions = count_rigid_modes(mesh, supports, Terms.of(energy).bends)
        if motions > self.most_rigid_modes:
            raise ValueError(
                f"The supports of this InverseProblem now leave {motions} rigid motions free, and at most "
                f"{self.most_rigid_modes} where it was built. Build it anew: problem.replace(supports=...)."
            )


def _kind(mesh: Mesh, energy: AbstractEnergy, supports: Supports | None) -> tuple:
    terms = tuple(
        (type(term).__qualname__, getattr(term, "form", None), getattr(term, "directors", None), _sizes(term))
        for _, term in energy.weighted_terms()
    )
    parts = () if supports is None else supports.parts()
    held = tuple((type(part).__qualname__, part.directions().tobytes(), _sizes(part)) for part in parts)
    return (mesh.n_vertices, mesh.n_faces), terms, held


def _sizes(part: Any) -> tuple:
    return tuple(leaf.shape for leaf in jax.tree.leaves(part) if _names_vertices(leaf))


def _names_vertices(leaf: Any) -> bool:
    return eqx.is_array(leaf) and not jnp.issubdtype(leaf.dtype, jnp.inexact)


def _contents(mesh: Mesh, energy: AbstractEnergy, supports: Supports | None) -> np.ndarray:
    digest = hashlib.blake2b(digest_size=16)
    for leaf in jax.tree.leaves((mesh.faces, energy, supports)):
        if _names_vertices(leaf):
            digest.update(np.ascontiguousarray(leaf).tobytes())
    for term in Terms.of(energy).measured:
        digest.update(np.ascontiguousarray(term.stencil(mesh), dtype=np.int64).tobytes())
    return np.frombuffer(digest.digest(), np.uint32)


def _said(kind: tuple) -> str:
    if kind and isinstance(kind[0], int):
        return f"{kind[0]} vertices and {kind[1]} faces"
    names = []
    for part in kind:
        details = [f"{what}={value!r}" for what, value in zip(("form", "directors"), part[1:3], strict=False)]
        plain = isinstance(part[1], bytes) or (part[1] is None and part[2] is None)
        names.append(part[0] if plain else f"{part[0]}({', '.join(details)})")
    return " + ".join(names) or "none"
