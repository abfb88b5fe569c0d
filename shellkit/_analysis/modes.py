"""How a shell vibrates about an equilibrium: the lowest modes of its exact Hessian and its lumped mass."""

from typing import Any, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Scalar

from .._energy import DofMap, Unknowns
from .._equilibrium import Equilibrium
from .._geometry.surface import edge_lengths, vertex_areas
from .._problem.problem import InverseProblem
from .._programs.tracing import with_parts
from .._relaxation.augmented_lagrangian import Stationary
from .._solve.linear.base import Factor
from .._solve.linear.bordered import Bordered, BorderedFactor, BorderedSolver
from .._solve.matrices.operator import SparseSymmetric


# Shifts are in units of the largest ratio of stiffness to mass at one unknown. The smallest leaves the matrix of a free
# shell regular by four digits; it grows until the matrix is positive definite, past the lowest eigenvalue of an
# unstable shape.
_SMALLEST_SHIFT, _LARGEST_SHIFT, _SHIFT_GROWTH = 1e-11, 1e2, 30.0
_AT_REST = 1e-12  # forces that would move no vertex by more than this fraction of an edge
_TOLERANCE = 1e-6
_MORE = 8  # modes sought beyond those asked for: of several that are equal, rounding brings up the last ones late

_Solver: TypeAlias = Any  # AbstractSparseSolver | BorderedSolver, each with its own factor
_Factor: TypeAlias = Factor | BorderedFactor


class Modes(eqx.Module):
    """The lowest modes of vibration about an equilibrium, in ascending order."""

    eigenvalues: Float[Array, " count"]
    r"""$\omega$ of $H x = \omega M x$, in units of stiffness over area; negative where the equilibrium is unstable."""
    modes: Float[Array, "count V 3"]
    r"""Displacements, orthonormal in the mass: $\sum_i m_i\, x_i \cdot x'_i$ is 1 for a mode and itself, else 0."""
    directors: Float[Array, "count E"] | None
    """How edge normals turn with each mode; `None` unless directors are free."""
    errors: Float[Array, " count"]
    """Bounds on the error of each eigenvalue, to first order, from the residuals."""
    equilibrium: Equilibrium
    """The shape about which the shell vibrates."""

    @property
    def converged(self) -> Bool[Array, ""]:
        """Whether each eigenvalue is exact to 1e-6 of itself, or to 1e-9 of the largest here."""
        size = jnp.maximum(jnp.abs(self.eigenvalues), 1e-3 * jnp.max(jnp.abs(self.eigenvalues)))
        return jnp.all(self.errors <= _TOLERANCE * size)

    def __str__(self) -> str:
        lines = ["mode        eigenvalue"]
        for number, (value, error) in enumerate(zip(self.eigenvalues, self.errors, strict=True)):
            lines.append(f"{number:4d}  {float(value):16.9e} ± {float(error):.0e}")
        return "\n".join(lines)


def vibration_modes(problem: InverseProblem, count: int = 10, equilibrium: Equilibrium | None = None) -> Modes:
    r"""The lowest modes of vibration of a shell about an equilibrium.

    $$H x = \omega M x,$$

    with $H$ the exact Hessian of the energy in the free unknowns and $M$ the lumped mass of a shell of unit mass per
    area of its surface at rest: a third of the area of its faces to each vertex. A shell of density $\rho$ and
    thickness $h$ has the angular frequencies $\sqrt{\omega / \rho h}$. Free directors carry no mass and follow. Rigid
    motions that nothing resists are among the modes, with eigenvalue zero. Where the energy has constraints the
    shapes are those that keep to first order what is held, and $H$ has the curvature of what holds it: the Hessian of
    the energy less multipliers times constraints.

    Found by Lanczos' method on the factorised, slightly shifted Hessian, then refined together with the rigid motions.
    Not for use under `jax.jit`, and not differentiable.

    **Arguments:**

    - `problem`: the shell.
    - `count`: how many modes; at most half of those that there are.
    - `equilibrium`: the shape to vibrate about; by default the surface at rest if that is an equilibrium, else
        `problem()`. Its multipliers, where the energy has constraints, are taken from it too.

    **Returns:**

    The [`shellkit.Modes`][].

    **Raises:**

    `ValueError` if `count` is out of range, or the Hessian is not finite or cannot be made positive definite by adding
    mass.

    ??? cite "Source"

        T. Ericsson and A. Ruhe, "The spectral transformation Lanczos method for the numerical solution of large sparse
        generalized symmetric eigenvalue problems", Math. Comp. 35 (1980), 1251–1268.
    """
    from scipy.linalg import eigh
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import LinearOperator, eigsh

    _check_count(problem, count)
    if equilibrium is None:
        equilibrium = problem.unrelaxed()
        pencil = _pencil(problem, equilibrium)
        if pencil.imbalance > _AT_REST:
            equilibrium = problem()
            pencil = _pencil(problem, equilibrium)
    else:
        pencil = _pencil(problem, equilibrium)
    if pencil.rigid is not None:
        free = np.asarray(jnp.any(pencil.rigid != 0, axis=1))
        pencil = with_parts(pencil, rigid=pencil.rigid[free] if free.any() else None)
    solver = problem.linear_solver()
    if isinstance(pencil.stiffness, Bordered):
        solver = BorderedSolver(solver)
    factor, shift = _factorise(solver, pencil)

    n = pencil.mass.shape[0]
    operator = lambda matvec: LinearOperator((n, n), matvec=matvec, dtype=float)  # pyright: ignore[reportCallIssue]
    _, found = eigsh(
        operator(lambda shape: np.asarray(pencil.image(jnp.asarray(shape).reshape(n)))),
        k=min(count + _MORE, n - 1),
        M=diags_array(np.asarray(pencil.mass)),
        sigma=-float(shift),
        OPinv=operator(lambda load: np.asarray(_solve(solver, factor, pencil, jnp.asarray(load).reshape(1, n)))[0]),
        v0=np.random.default_rng(0).normal(size=n),
    )
    # One more inverse iteration, of all modes in one call, and the best combinations of them and the rigid motions.
    basis, energies, masses = _subspace(solver, factor, pencil, jnp.asarray(found.T))
    values, mixture = eigh(energies, masses)
    values, shapes = jnp.asarray(values[:count]), jnp.asarray(mixture.T[:count]) @ basis
    errors = _errors(solver, factor, pencil, shift, values, shapes)
    modes = _fields(problem.assembly.dofs, shapes)
    return Modes(values, modes.vertices, modes.directors, errors, equilibrium)


def _check_count(problem: InverseProblem, count: int) -> None:
    free, massive = problem.assembly.dofs.free, 3 * problem.mesh.n_vertices
    available = massive if free is None else int(np.count_nonzero(np.asarray(free) < massive))
    available -= problem.origin.most_rigid_modes
    available -= problem.assembly.n_constraints
    if not 1 <= count <= available // 2:
        raise ValueError(
            f"vibration_modes: count={count}, but it must be between 1 and {available // 2}, half the number of modes; "
            "for more, decompose problem.hessian(vertices).as_matrix() in full."
        )


class _Pencil(eqx.Module):
    """Stiffness and lumped mass of the free unknowns, and the rigid motions that cost nothing."""

    stiffness: SparseSymmetric | Bordered
    mass: Float[Array, " n"]
    rigid: Float[Array, "k n"] | None
    """One a row, orthonormal in the mass; zeros for one that something hinders, until they are left out."""
    imbalance: Scalar
    """The largest force, as the part of an edge by which it would move its vertex."""
    unit: Scalar
    """The largest ratio of stiffness to mass at one unknown: about the largest eigenvalue."""

    def elastic(self, shapes: Float[Array, "k n"]) -> Float[Array, "k n"]:
        """The part of some shapes that is orthogonal, in the mass, to rigid motions."""
        return shapes if self.rigid is None else shapes - (shapes * self.mass) @ self.rigid.T @ self.rigid

    def image(self, shape: Float[Array, " n"]) -> Float[Array, " n"]:
        """Stiffness times a shape; springs that hold quantities resist it as well."""
        stiffness = self.stiffness
        if isinstance(stiffness, SparseSymmetric):
            return stiffness.mv(shape)
        springs = stiffness.compliances > 0
        forces = jnp.where(springs, stiffness.rows @ shape / jnp.where(springs, stiffness.compliances, 1.0), 0.0)
        return stiffness.sparse.mv(shape) + forces @ stiffness.rows

    def self_balanced(self, loads: Float[Array, "k n"]) -> Float[Array, "k n"]:
        """The part of some loads that does no work on rigid motions."""
        return loads if self.rigid is None else loads - (loads @ self.rigid.T) @ (self.rigid * self.mass)


@eqx.filter_jit
def _pencil(problem: InverseProblem, equilibrium: Equilibrium) -> _Pencil:
    dofs, mesh = problem.assembly.dofs, problem.mesh
    energy = problem.discrete_energy()
    y = dofs.gather(equilibrium.unknowns)
    if energy.constraints is None:
        stiffness = matrix = energy.hessian(y)
    else:
        m = len(energy.constraints.targets)
        multipliers = jnp.zeros(m) if equilibrium.multipliers is None else equilibrium.multipliers
        stiffness = Stationary(energy).hessian(jnp.concatenate([y, multipliers]))
        energy, matrix = energy.with_multipliers(multipliers), stiffness.sparse
    assert isinstance(matrix, SparseSymmetric)
    areas = vertex_areas(mesh.vertices, mesh)
    mass = dofs.per_unknown(areas, 0.0)
    rigid = None
    motions = problem.rigid_modes()
    if motions is not None:
        fields = motions(y)
        gram = fields.T @ (mass[:, None] * fields)
        absent = jnp.diagonal(gram) == 0
        gram = gram + jnp.diag(absent.astype(gram.dtype))
        rigid = jax.scipy.linalg.solve_triangular(jnp.linalg.cholesky(gram), fields.T, lower=True)
    diagonal = jnp.abs(matrix.values[matrix.pattern.diagonal])
    force = jnp.max(jnp.abs(energy.gradient(y)))
    imbalance = force / (jnp.mean(diagonal) * jnp.mean(edge_lengths(mesh.vertices, mesh)))
    unit = jnp.max(jnp.where(mass > 0, diagonal / jnp.where(mass > 0, mass, 1.0), 0.0))
    return _Pencil(stiffness, mass, rigid, imbalance, unit)


def _factorise(solver: _Solver, pencil: _Pencil) -> tuple[_Factor, Scalar]:
    """Factorise H + sM with the smallest shift s tried that makes it positive definite."""
    shift = _SMALLEST_SHIFT
    while shift < _LARGEST_SHIFT:
        factor = _factorise_shifted(solver, pencil, shift * pencil.unit)
        if factor.ok and factor.negative <= 0:
            return factor, shift * pencil.unit
        shift *= _SHIFT_GROWTH
    raise ValueError(
        "vibration_modes: the Hessian is not finite at this shape, or unstable in unknowns that carry no mass (free "
        "directors). Give an equilibrium that converged, and look at its vertices."
    )


@eqx.filter_jit
def _factorise_shifted(solver: _Solver, pencil: _Pencil, shift: Scalar) -> _Factor:
    sparse = pencil.stiffness.sparse if isinstance(pencil.stiffness, Bordered) else pencil.stiffness
    added = jnp.zeros_like(sparse.values).at[sparse.pattern.diagonal].add(shift * pencil.mass)
    return solver.factorise(pencil.stiffness.plus(added))


@eqx.filter_jit
def _solve(solver: _Solver, factor: _Factor, pencil: _Pencil, loads: Float[Array, "k n"]) -> Float[Array, "k n"]:
    """(H + sM)⁻¹ on the complement of rigid motions, which a small shift leaves nearly free."""
    return pencil.elastic(solver.solve(factor, pencil.self_balanced(loads)))


@eqx.filter_jit
def _subspace(
    solver: _Solver, factor: _Factor, pencil: _Pencil, found: Float[Array, "k n"]
) -> tuple[Float[Array, "m n"], Float[Array, "m m"], Float[Array, "m m"]]:
    """A basis of rigid motions and the modes found, improved; with twice its energies, and its masses."""
    basis = _solve(solver, factor, pencil, found * pencil.mass)
    basis = basis if pencil.rigid is None else jnp.concatenate([pencil.rigid, basis])
    energies = basis @ jax.vmap(pencil.image)(basis).T
    return basis, 0.5 * (energies + energies.T), basis @ (pencil.mass * basis).T


@eqx.filter_jit
def _errors(
    solver: _Solver,
    factor: _Factor,
    pencil: _Pencil,
    shift: Scalar,
    values: Float[Array, " k"],
    shapes: Float[Array, "k n"],
) -> Float[Array, " k"]:
    """Bounds on the errors of eigenvalues: the residual in the norm of the inverse, and rounding."""
    residuals = jax.vmap(pencil.image)(shapes) - values[:, None] * pencil.mass * shapes
    corrections = _solve(solver, factor, pencil, residuals)
    sizes = jnp.sqrt(jnp.sum(pencil.mass * corrections**2, axis=1))
    return jnp.abs(values + shift) * sizes + jnp.finfo(values.dtype).eps * pencil.unit


@eqx.filter_jit
def _fields(dofs: DofMap, shapes: Float[Array, "k n"]) -> Unknowns:
    """Displacements and turns of edge normals from free unknowns, of each shape."""
    return jax.vmap(dofs.motion)(shapes)
