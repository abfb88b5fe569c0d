"""The director fields that a picture or a file is to show: those of a problem, of an actuation, or angles given
outright."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import ArrayLike

from .._mesh.mesh import Mesh
from . import Actuation


Directors = bool | Actuation | ArrayLike | Sequence | None


def director_layers(
    owner: str, mesh: Mesh, actuation: Actuation | None, directors: Directors
) -> tuple[np.ndarray, ...]:
    """The angles of each layer, the top one first: those asked for, or with `True` those that the actuation has."""
    if directors is None or directors is False:
        return ()
    fields: Any
    if directors is True:
        fields = () if actuation is None else actuation.on(mesh).director_fields()
    elif isinstance(directors, Actuation):
        fields = directors.on(mesh).director_fields()
    else:
        fields = directors if isinstance(directors, (list, tuple)) and np.ndim(directors[0]) else [directors]
    layers = tuple(np.asarray(field, dtype=float) for field in fields)
    for layer in layers:
        if layer.shape != (mesh.n_faces,):
            raise ValueError(
                f"{owner}: directors has a layer of shape {layer.shape}; give one angle per face, shape "
                f"({mesh.n_faces},), or a list of such layers."
            )
    return layers


def layer_names(count: int) -> tuple[str, ...]:
    """What the layers are called."""
    return {1: ("directors",), 2: ("top", "bottom")}.get(count) or tuple(f"layer {k + 1}" for k in range(count))
