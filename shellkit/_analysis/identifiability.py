"""Which parameters a shape tells of, and which it does not: the singular values and directions of the derivative of an
equilibrium in the arrays of its problem."""

from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, PyTree

from .._equilibrium import Equilibrium
from .._fit.design import Design, split
from .._problem.problem import InverseProblem
from .._problem.states import Equilibria, Shape, Shell, States
from .._solve.null_space import orthonormal, project_out


_BLOCK = 32  # directions a call
_DENSE = 600  # columns or rows up to which the derivative is formed in full
_DENSE_PARAMETERS = 3000
_COUNT = 50
_OVERSAMPLING = 10
_MAX_BLOCKS, _CHANGE = 20, 1e-10


class Identifiability(eqx.Module):
    r"""How the shape at equilibrium depends on parameters, to first order; printing it gives a summary.

    A change $\delta\theta$ of the parameters moves the shape by $J \delta\theta$, less the rigid motion in it. Here is
    the decomposition $J/\sqrt V = \sum_k \sigma_k u_k p_k^\top$, with parameters in units of `scale`: a unit change
    along $p_k$ moves the vertices by $\sigma_k$ (root mean square). Directions with small $\sigma_k$ are patterns that
    the shape cannot see; those with large ones are where it is sensitive.
    """

    singular_values: Float[Array, " k"]
    r"""$\sigma_k$, in the unit of the mesh, in descending order."""
    directions: dict[str, Array]
    """$p_k$, orthonormal: for each array by its name, shape (k, ...) with the shape of the array behind."""
    shapes: Float[Array, "k V 3"]
    """$u_k$, as fields with a mean square of one over the vertices, those of all states one after another; zero where
    $\\sigma_k$ is."""
    scale: dict[str, Array]
    """The unit of each parameter, in the shape of its array."""
    equilibrium: Any
    """Where the derivative was taken: an [`shellkit.Equilibrium`][], or those of all states."""
    complete: bool = eqx.field(static=True)
    """Whether these are all directions; if not, all others have smaller singular values."""

    def rank(self, tolerance: float = 1e-6) -> int:
        """How many directions the shape tells of.

        **Arguments:**

        - `tolerance`: of the largest singular value; what moves the shape by less does not count.
        """
        values = np.asarray(self.singular_values)
        return int(np.count_nonzero(values > tolerance * values.max(initial=0.0)))

    def components(self, change: Mapping[str, ArrayLike]) -> Float[Array, " k"]:
        """A change of the parameters in terms of the directions.

        **Arguments:**

        - `change`: by the names of the arrays, each in the shape of its array; in the units of the arrays. What is left
            out does not change.
        """
        total = jnp.zeros(len(self.singular_values))
        for name, value in self._checked(change).items():
            axes = self.directions[name]
            total = total + axes.reshape(len(total), -1) @ (value / self.scale[name]).reshape(-1)
        return total

    def seen(self, change: Mapping[str, ArrayLike], threshold: float) -> dict[str, Array]:
        """The part of a change of the parameters that the shape sees.

        **Arguments:**

        - `change`: as for `components`.
        - `threshold`: the singular value from which on a direction counts as seen, in the unit of the mesh.

        **Returns:**

        By the names of all arrays, in their units. The rest of the change moves the shape by less than the threshold
        for each unit of it.
        """
        weights = jnp.where(self.singular_values >= threshold, self.components(change), 0.0)
        return {name: self.scale[name] * jnp.tensordot(weights, axes, 1) for name, axes in self.directions.items()}

    def displacement(self, change: Mapping[str, ArrayLike]) -> Float[Array, "V 3"]:
        """How far a change of the parameters moves each vertex, to first order, less the rigid motion.

        **Arguments:**

        - `change`: as for `components`.
        """
        return jnp.tensordot(self.singular_values * self.components(change), self.shapes, 1)

    def posterior(self, noise: float, prior: float = 1.0) -> dict[str, Array]:
        r"""How well a measured shape tells each parameter: its standard deviation by Laplace's approximation.

        The covariance is $\left(J^\top J / s^2 + 1/p^2\right)^{-1}$ in units of `scale`, for vertices each of which is
        measured with noise, with the rigid motion unknown. The shape tells nothing of a parameter that comes out with
        the standard deviation of the prior. Directions that are not among these count as unseen.

        **Arguments:**

        - `noise`: $s$, the standard deviation of each coordinate of each vertex, in the unit of the mesh.
        - `prior`: $p$, the standard deviation of each parameter before the measurement, in units of `scale`.

        **Returns:**

        By the names of the arrays, in their units and shapes.
        """
        information = self.shapes.shape[1] * self.singular_values**2 / noise**2
        told = information / (information + 1 / prior**2)
        spread = {}
        for name, axes in self.directions.items():
            left = jnp.maximum(1.0 - jnp.tensordot(told, axes**2, 1), 0.0)
            spread[name] = prior * self.scale[name] * jnp.sqrt(left)
        return spread

    def tolerance(self, spread: float = 1.0) -> Float[Array, " V"]:
        """How far each vertex strays (root mean square) when each parameter does by itself, at random, to first order.

        A lower bound if the directions are not complete. The root mean square over the vertices is `spread` times that
        of the sum of the squared singular values.

        **Arguments:**

        - `spread`: the standard deviation of each parameter as fabricated, in units of `scale`.
        """
        return spread * jnp.sqrt(jnp.sum((self.singular_values[:, None, None] * self.shapes) ** 2, axis=(0, 2)))

    def _checked(self, change: Mapping[str, ArrayLike]) -> dict[str, Array]:
        checked = {}
        for name, value in change.items():
            if name not in self.directions:
                raise ValueError(f"change names {name!r}, which is not among {', '.join(self.directions)}.")
            value, expected = jnp.asarray(value, dtype=float), self.directions[name].shape[1:]
            if value.shape != expected:
                raise ValueError(f"change of {name} has shape {value.shape}; expected {expected}.")
            checked[name] = value
        return checked

    def __str__(self) -> str:
        values = np.asarray(self.singular_values)
        parameters = sum(int(np.prod(axes.shape[1:])) for axes in self.directions.values())
        top = values.max(initial=0.0)
        lines = [f"{parameters} parameters, {3 * self.shapes.shape[1]} coordinates of vertices"]
        for part in (1e-1, 1e-2, 1e-3, 1e-6):
            count = np.count_nonzero(values > part * top)
            lines.append(f"{count:6d} directions move the shape by more than {part:.0e} of {top:.3g}")
        if not self.complete:
            lines.append(f"the {len(values)} largest only: others are below {values[-1]:.3g}")
        return "\n".join(lines)


def identifiability(
    problem: Shell,
    where: Callable[[Any], PyTree] | None = None,
    scale: float | Mapping[str, ArrayLike] = 1.0,
    count: int | None = None,
    equilibrium: Shape | None = None,
    seed: int = 0,
) -> Identifiability:
    r"""Which parameters the shape at equilibrium tells of, and to which it is sensitive.

    The singular value decomposition of the derivative of the shape in the parameters, modulo rigid motions that nothing
    hinders. Products with the derivative and with its transpose are each one solve with the factor of the relaxation.
    Small problems are decomposed in full; of large ones the leading directions are found by block Lanczos
    bidiagonalisation from a random start. First order: it speaks of small changes. On the host; not for use under
    `jax.jit`.

    **Arguments:**

    - `problem`: the shell, or its states: what one shape cannot tell, several may. It needs no loss.
    - `where`: a function from the problem to the array or arrays that count as parameters; by default those of the
        actuation.
    - `scale`: a change of each parameter that counts as equal to that of others, in its own unit: one number, or by
        the names of arrays, such as `{"actuation.top.angle": 0.1}` (the rest count 1).
    - `count`: how many directions; by default all for up to 600 parameters or coordinates, else 50.
    - `equilibrium`: where to take the derivative; by default `problem()`.
    - `seed`: of the random start.

    **Returns:**

    The [`shellkit.Identifiability`][].

    **Raises:**

    `ValueError` if the relaxation does not converge, or `where`, `scale` or `count` do not fit.

    ??? cite "Source"

        G. H. Golub, F. T. Luk and M. L. Overton, "A block Lanczos method for computing the singular values and
        corresponding singular vectors of a matrix", ACM Trans. Math. Software 7 (1981), 149.
    """
    design, values = split(problem, where)
    scales = _scales(values, scale)
    if equilibrium is None:
        equilibrium = problem()
    if not bool(equilibrium.converged):
        raise ValueError(
            "identifiability: the relaxation did not converge, so its shape has no derivative. Look at "
            "shellkit.RESULTS[equilibrium.result], or give an equilibrium found along a path."
        )
    parameters = sum(value.size for value in values.values())
    vertices = sum(state.mesh.n_vertices for state, _ in _shells(problem, equilibrium))
    coordinates = 3 * vertices
    smaller = min(parameters, coordinates)
    if count is not None and not 1 <= count <= smaller:
        raise ValueError(f"identifiability: count={count}, but it must be between 1 and {smaller}.")
    derivative = _Derivative(design, values, scales, equilibrium)
    if count is None and smaller <= _DENSE and parameters <= _DENSE_PARAMETERS:
        left, sizes, right = _in_full(derivative, parameters, coordinates)
    else:
        wanted = min(_COUNT, smaller) if count is None else count
        left, sizes, right = _leading(derivative, parameters, wanted, min(wanted + _OVERSAMPLING, smaller), seed)
    directions, at = {}, 0
    for name in design.names:
        value = values[name]
        directions[name] = jnp.asarray(right[:, at : at + value.size]).reshape(-1, *value.shape)
        at += value.size
    shapes = np.sqrt(vertices) * left.reshape(-1, vertices, 3)
    return Identifiability(
        singular_values=jnp.asarray(sizes),
        directions=directions,
        shapes=jnp.asarray(shapes),
        scale=scales,
        equilibrium=equilibrium,
        complete=len(sizes) == parameters,
    )


def _scales(values: dict[str, Array], scale: float | Mapping[str, ArrayLike]) -> dict[str, Array]:
    given = scale if isinstance(scale, Mapping) else dict.fromkeys(values, scale)
    unknown = [name for name in given if name not in values]
    if unknown:
        raise ValueError(f"identifiability: scale names {unknown[0]!r}, which is not among {', '.join(values)}.")
    scales = {}
    for name, value in values.items():
        scales[name] = jnp.broadcast_to(jnp.asarray(given.get(name, 1.0), dtype=float), value.shape)
        if not bool(jnp.all(scales[name] > 0)):
            raise ValueError(f"identifiability: the scale of {name} must be positive.")
    return scales


class _Derivative:
    """The derivative of the shape, over the root of the number of vertices, in the parameters in units of their scale:
    products with blocks of directions, one per row."""

    def __init__(self, design: Design, values: dict[str, Array], scales: dict[str, Array], equilibrium: Shape):
        self.parts = design, values, scales, equilibrium

    def forward(self, rows: np.ndarray) -> np.ndarray:
        return self._blocks(_forward, rows)

    def backward(self, rows: np.ndarray) -> np.ndarray:
        return self._blocks(_backward, rows)

    def _blocks(self, product, rows: np.ndarray) -> np.ndarray:
        # All calls have blocks of one size, so that each product is compiled once.
        found = []
        for at in range(0, len(rows), _BLOCK):
            block = np.zeros((_BLOCK, rows.shape[1]))
            part = rows[at : at + _BLOCK]
            block[: len(part)] = part
            found.append(np.asarray(product(*self.parts, jnp.asarray(block)))[: len(part)])
        return np.concatenate(found)


def _shells(problem: Shell, equilibrium: Shape) -> list[tuple[InverseProblem, Equilibrium]]:
    """The single shells of a design with their equilibria: one, or one for each state."""
    if isinstance(problem, States):
        assert isinstance(equilibrium, Equilibria)
        return [(problem[name], equilibrium[name]) for name in problem.names]
    assert isinstance(equilibrium, Equilibrium)
    return [(problem, equilibrium)]


def _rigid_basis(problem: InverseProblem, equilibrium: Equilibrium) -> Float[Array, "m k"] | None:
    """Rigid motions of the vertices that cost nothing, orthonormal; `None` if there is none."""
    motions = problem.rigid_modes()
    if motions is None:
        return None
    dofs = problem.assembly.dofs
    fields = jax.vmap(lambda motion: dofs.motion(motion).vertices.reshape(-1), in_axes=1, out_axes=1)
    return orthonormal(jax.lax.stop_gradient(fields(motions(dofs.gather(equilibrium.unknowns)))))


def _shape(design: Design, values: dict[str, Array], scales: dict[str, Array], equilibrium: Shape):
    """The shape, or those of all states one after another, as a function of the flat changes of the parameters, modulo
    rigid motions."""
    shells = _shells(design.problem(values), equilibrium)
    bases = [_rigid_basis(*shell) for shell in shells]
    vertices = sum(problem.mesh.n_vertices for problem, _ in shells)

    def shape(change: Float[Array, " n"]) -> Float[Array, " m"]:
        moved, at = {}, 0
        for name in design.names:  # in this order: that of a dictionary does not survive jit
            value = values[name]
            moved[name] = value + scales[name] * change[at : at + value.size].reshape(value.shape)
            at += value.size
        problem = design.problem(moved)
        shapes = []
        for (_, found), basis in zip(_shells(problem, problem.near(equilibrium)), bases, strict=True):
            shapes.append(project_out(basis, found.vertices.reshape(-1)))
        return jnp.concatenate(shapes) / jnp.sqrt(vertices)

    return shape, jnp.zeros(sum(value.size for value in values.values()))


@eqx.filter_jit
def _forward(design, values, scales, equilibrium, rows: Float[Array, "b n"]) -> Float[Array, "b m"]:
    shape, here = _shape(design, values, scales, equilibrium)
    return jax.lax.map(jax.linearize(shape, here)[1], rows)


@eqx.filter_jit
def _backward(design, values, scales, equilibrium, rows: Float[Array, "b m"]) -> Float[Array, "b n"]:
    shape, here = _shape(design, values, scales, equilibrium)
    transpose = jax.linear_transpose(jax.linearize(shape, here)[1], here)
    return jax.lax.map(lambda row: transpose(row)[0], rows)


def _in_full(derivative: _Derivative, parameters: int, coordinates: int):
    """All singular values and directions, those that do nothing included."""
    if parameters <= coordinates:
        matrix = derivative.forward(np.eye(parameters)).T
    else:
        matrix = derivative.backward(np.eye(coordinates))
    # With more parameters than coordinates, the directions of which the shape tells nothing complete the others.
    left, sizes, right = np.linalg.svd(matrix, full_matrices=parameters > coordinates)
    idle = parameters - len(sizes)
    return np.concatenate([left.T, np.zeros((idle, coordinates))]), np.append(sizes, np.zeros(idle)), right


def _leading(derivative: _Derivative, parameters: int, count: int, width: int, seed: int):
    """The largest singular values and their directions, by block Lanczos bidiagonalisation: the basis of shapes grows
    by a block until the values stand still, or there is no more."""
    moved = derivative.forward(np.random.default_rng(seed).normal(size=(width, parameters)))
    block = _orthonormal(moved)
    if len(block) == 0:  # nothing moves the shape at all
        return np.zeros((count, moved.shape[1])), np.zeros(count), np.eye(count, parameters)
    shapes, patterns, last = block, np.zeros((0, parameters)), np.zeros(count)
    for _ in range(_MAX_BLOCKS):
        patterns = np.concatenate([patterns, derivative.backward(block)])
        mixture, sizes, right = np.linalg.svd(patterns, full_matrices=False)
        values = np.pad(sizes, (0, count))[:count]
        if np.abs(values - last).max() <= _CHANGE * max(values[0], 1e-300):
            break
        last = values
        block = derivative.forward(patterns[-len(block) :])
        for _ in range(2):
            block = block - block @ shapes.T @ shapes
        block = _orthonormal(block, 1e-12 * values[0] ** 2)
        if len(block) == 0:
            break
        shapes = np.concatenate([shapes, block])
    return (mixture.T @ shapes)[:count], sizes[:count], right[:count]


def _orthonormal(rows: np.ndarray, least: float = 0.0) -> np.ndarray:
    """An orthonormal basis of some rows, less what is shorter than a length."""
    _, sizes, basis = np.linalg.svd(rows, full_matrices=False)
    return basis[sizes > max(least, 1e-14 * sizes.max(initial=0.0))]
