"""Energy, gradient and Hessian of a user's own term, by automatic differentiation of one element."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PyTree, Scalar

from ..base import EnergyTerm


class Elements(eqx.Module):
    """One term with its stencil, its weight and its data for one rest shape."""

    term: EnergyTerm
    weight: Scalar | None
    data: PyTree[Array]
    stencil: Int[Array, "N k"]

    def engaged(self) -> "Elements":
        """The same elements where they act, see [`shellkit.EnergyTerm.engaged`][]; without their weight."""
        return Elements(self.term.engaged(), None, self.data, self.stencil)

    def _map(self, function: Callable, vertices: Float[Array, "V 3"]) -> Any:
        return jax.vmap(function)(vertices[self.stencil], self.data)

    def _weighted(self, value: Array) -> Array:
        return value if self.weight is None else self.weight * value

    def energy(self, vertices: Float[Array, "V 3"]) -> Scalar:
        """The sum over all elements."""
        return self._weighted(jnp.sum(self._map(self.term.element_energy, vertices)))

    def value_and_gradient(self, vertices: Float[Array, "V 3"]) -> tuple[Scalar, Float[Array, "N k 3"]]:
        """The sum over all elements, and its derivatives in the positions of each element."""
        values, gradients = self._map(jax.value_and_grad(self.term.element_energy), vertices)
        return self._weighted(jnp.sum(values)), self._weighted(gradients)

    def hessian(self, vertices: Float[Array, "V 3"]) -> Float[Array, "N k 3 k 3"] | None:
        """Second derivatives in the positions of each element; `None` for a term that is linear in them."""
        if self.term.linear:
            return None
        return self._weighted(self._map(jax.hessian(self.term.element_energy), vertices))
