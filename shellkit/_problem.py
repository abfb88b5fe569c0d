"""The inverse problem: a surface, what actuates it, what deformation costs, and what shape is wanted."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax.core import Tracer
from jaxtyping import Array, Float, Scalar

from ._actuation import Actuation, Passive
from ._align import Kabsch
from ._citation import citation
from ._energy import AbstractEnergy, Assembly, Constraint, DiscreteEnergy, FormEnergy, refuse_held_moments
from ._equilibrium import RESULTS, Equilibrium
from ._geometry.forms import CurvatureForm
from ._geometry.patches import Hinges, Triangles
from ._geometry.surface import edge_lengths
from ._holding import Stationary, differentiable_held, padded
from ._loss import Loss
from ._mesh.mesh import Mesh
from ._papers import BRADBURY_2018, KIDGER_2021, RADER_2024
from ._precision import require_x64
from ._relaxation import End, minimised, minimised_held
from ._rest import RestShape, checked_rest_lengths
from ._solve.adjoint import differentiable_minimum
from ._solve.bordered import BorderedSolver
from ._solve.choose import default_direct_solver
from ._solve.direct import AbstractSparseSolver
from ._solve.newton import SparseNewton
from ._solve.operator import SparseSymmetric
from ._solve.response import responding_minimum
from ._supports import Supports
from ._symmetries import FreeMotions, free_motions


_STEPS_OF_FIRST_ORDER_METHODS = 10_000
_FOLDED = 179.0  # degrees


class InverseProblem(eqx.Module):
    """A shell, its actuation, its energy and the loss of its equilibrium.

    Calling it relaxes the shell and returns the [`shellkit.Equilibrium`][]; `evaluate` goes on to the loss. Both are
    functions of every array in the problem, and can be differentiated in any of them, forwards and backwards, by one
    solve with the Hessian there.

    ??? example

        ```python
        problem = sk.InverseProblem(
            mesh=mesh,
            thickness=0.1,
            actuation=sk.Nematic(angle=jnp.zeros(mesh.n_faces), stretch=1.1),
            energy=sk.StVenantKirchhoff(alpha=1.0, beta=1.0) + sk.Bending(alpha=1.0, beta=1.0),
            loss=sk.VertexDistance(target, aligner=sk.Kabsch()),
        )
        equilibrium = problem()
        value, terms = problem.evaluate()
        gradients = eqx.filter_grad(lambda p: p.evaluate()[0])(problem)
        ```
    """

    papers: ClassVar[tuple[str, ...]] = (BRADBURY_2018, KIDGER_2021, RADER_2024)
    mesh: Mesh
    thickness: Float[Array, "..."]
    actuation: Actuation
    energy: AbstractEnergy
    supports: Supports | None
    loss: Loss | None
    solver: optx.AbstractMinimiser
    max_steps: int | None = eqx.field(static=True)
    rest_lengths: str = eqx.field(static=True)
    assembly: Assembly
    motions: FreeMotions | None

    def __init__(
        self,
        mesh: Mesh,
        thickness: float | Array,
        energy: AbstractEnergy,
        actuation: Actuation | None = None,
        loss: Loss | None = None,
        solver: optx.AbstractMinimiser | None = None,
        max_steps: int | None = None,
        supports: Supports | None = None,
        rest_lengths: str = "own",
    ):
        """**Arguments:**

        - `mesh`: the surface at rest.
        - `thickness`: of the shell, one number or one a face, in the unit of the mesh.
        - `energy`: what deformation costs; a sum of terms.
        - `actuation`: what the shell would like to become; by default it stays as it is.
        - `loss`: what is wanted of the equilibrium; only `evaluate` needs it.
        - `solver`: any minimiser of optimistix; by default [`shellkit.SparseNewton`][].
        - `max_steps`: of the minimiser; by default its own limit, or 10,000 for one that has none.
        - `supports`: what is held, such as [`shellkit.Clamped`][]; by default nothing. Which vertices they hold, and in
            which directions, is settled here; where they hold them can be changed and trained.
        - `rest_lengths`: `"own"`, each face has its rest metric as the actuation gives it, or `"shared"`, both faces of
            an edge have the same rest length along it: far more accurate for samples of a smooth field of directors or
            growth, see [`shellkit.RestShape`][].

        **Raises:** `ValueError` if a part does not fit the mesh or the other parts; the message says what to change.
        """
        require_x64("InverseProblem")
        self.mesh = mesh
        self.thickness = _checked_thickness(thickness, mesh)
        self.actuation = Passive() if actuation is None else actuation
        self.supports = None if supports is None else supports.on(mesh)
        self.loss = loss
        self.solver = SparseNewton() if solver is None else solver
        self.max_steps = max_steps
        self.actuation.check(mesh)
        for _, term in energy.weighted_terms():
            term.check(mesh)
        self.energy = energy.on(mesh)
        _check_constraints(self.energy, self.solver)
        _check_one_curvature([term for _, term in energy.weighted_terms()])
        if self.supports is not None:
            self.supports.check(mesh)
            refuse_held_moments(self.energy, [part.held_edges(mesh) for part in self.supports.parts()], mesh)
        if loss is not None:
            loss.check(mesh, self.actuation)
        self.assembly = Assembly.of(self.energy, mesh, self.supports)
        self.rest_lengths = checked_rest_lengths(rest_lengths)
        self.motions = free_motions(self.energy, mesh, self.rest_shape(), self.assembly, self.supports)

    def rest_shape(self) -> RestShape:
        """The rest shape under actuation."""
        terms = (term for _, term in self.energy.weighted_terms())
        forms: list[CurvatureForm] = [t.form for t in terms if isinstance(t, FormEnergy) and t.form is not None]
        beyond = None if self.supports is None or not forms else self.supports.at(0.0).continuation(self.mesh)
        rest = RestShape.of(self.mesh, self.thickness, forms[0] if forms else None, beyond)
        actuated = self.actuation(rest)
        shared = self.rest_lengths == "shared" and not isinstance(self.actuation, Passive)
        return actuated.sharing_edges(self.mesh) if shared else actuated

    def discrete_energy(self) -> DiscreteEnergy:
        """The energy as a function of the vector of free unknowns, with its gradient and sparse Hessian."""
        held, beyond = self.mesh.vertices, None
        if self.supports is not None:
            held, beyond = self.supports.held_positions(self.mesh), self.supports.continuation(self.mesh)
        held = self.assembly.join(held, None)
        return DiscreteEnergy(self.energy, self.mesh, self.rest_shape(), self.assembly, held, beyond)

    def rigid_motions(self) -> FreeMotions | None:
        """The rigid motions that cost nothing, with the supports where they are now; `None` if there is none."""
        if self.motions is None or self.supports is None:
            return self.motions
        held = self.assembly.join(self.supports.held_positions(self.mesh), None)
        return eqx.tree_at(lambda motions: motions.held, self.motions, held)

    def total_energy(self, vertices: Float[Array, "V 3"], directors: Float[Array, " E"] | None = None) -> Scalar:
        """The energy of any shape, in units of pressure times volume; held vertices are where they are held.

        **Arguments:**

        - `vertices`: positions, in the unit of the mesh.
        - `directors`: angles by which edge normals are turned, where directors are free; by default zero.
        """
        return self.discrete_energy()(self.assembly.restrict(self.assembly.join(vertices, directors)))

    def hessian(self, vertices: Float[Array, "V 3"], directors: Float[Array, " E"] | None = None) -> SparseSymmetric:
        """The Hessian of the energy at any shape, a sparse lineax operator that acts on fields like `vertices`.

        Where directors are free it acts on pairs `(vertices, directors)`; where supports hold something, on the flat
        vector of the unknowns that are left. `vertices` and `directors` are as for `total_energy`.

        **Raises:** `ValueError` where the energy has constraints: what they add is dense.
        """
        if any(isinstance(term, Constraint) for _, term in self.energy.weighted_terms()):
            raise ValueError("The Hessian of an energy with constraints is not sparse; take the constraints out of it.")
        energy = self.discrete_energy()
        y = self.assembly.restrict(self.assembly.join(vertices, directors))
        flat = energy.hessian(y)
        assert isinstance(flat, SparseSymmetric)
        values = flat.values
        if self.assembly.director_length is not None:
            # Derivatives in angles, from those in the unknowns of a relaxation.
            ones = jnp.ones(self.assembly.n_directors) * self.assembly.director_length
            angles = self.assembly.restrict(jnp.concatenate([jnp.ones(3 * self.mesh.n_vertices), ones]))
            values = values * angles[flat.pattern.rows] * angles[flat.pattern.indices]
        return SparseSymmetric(flat.pattern, values, like=self.assembly.like(vertices.dtype))

    def __call__(self, start: Equilibrium | None = None) -> Equilibrium:
        """Relax the shell.

        **Arguments:**

        - `start`: an equilibrium to start from; by default the surface at rest, which is what an experiment does.

        **Returns:** the [`shellkit.Equilibrium`][]. A relaxation that fails returns what it has, with the reason in
        `result`.
        """
        # What is compiled does not depend on the loss, so problems that differ in it share one program.
        return _relax(eqx.tree_at(lambda p: p.loss, self, None, is_leaf=lambda x: x is None), start)

    def _relaxed(self, start: Equilibrium | None) -> Equilibrium:
        energy = self.discrete_energy()
        still = _stop(energy)
        if start is None:
            unknowns = self.assembly.join(self.mesh.vertices, None)
        else:
            unknowns = self.assembly.join(start.vertices, start.directors)
        y0 = jax.lax.stop_gradient(self.assembly.restrict(unknowns))
        motions = _stop(self.rigid_motions())
        length = jax.lax.stop_gradient(jnp.mean(edge_lengths(self.mesh.vertices, self.mesh)))
        linear_solver = self.linear_solver()
        multipliers = None
        if energy.quantities is None:
            end = minimised(still, y0, motions, length, self.solver, linear_solver, self._step_limit())
            y = differentiable_minimum(energy, end.y, motions, linear_solver, end.last)
        else:
            assert isinstance(self.solver, SparseNewton)  # as was checked when the problem was built
            first = None if start is None else start.multipliers
            end, held = minimised_held(still, y0, first, motions, length, self.solver, self._step_limit())
            y, multipliers = differentiable_held(energy, held, motions, linear_solver)
            energy = energy.held_by(multipliers)
        return self._report(still, end, self.posed(energy, y), multipliers)

    def _report(self, energy: DiscreteEnergy, end: End, posed: tuple, multipliers: Array | None) -> Equilibrium:
        vertices, directors, reactions, moments = posed
        converged = end.result == optx.RESULTS.successful
        result = RESULTS.promote(end.result)
        result = RESULTS.where(end.result == optx.RESULTS.nonlinear_divergence, RESULTS.stuck, result)
        worst_hinge = None
        if energy.faces is not None and energy.faces.form is not None:
            positions = jax.lax.stop_gradient(vertices)
            angles = jnp.abs(Hinges(positions, self.mesh, Triangles(positions, self.mesh)).angles)
            flat = jnp.argmax(angles)
            worst_hinge = self.mesh.face_edges.T.reshape(-1)[flat]
            folded = ~converged & (jnp.max(angles) > jnp.deg2rad(_FOLDED))
            # Only an averaged normal vanishes on a fold, and only a form that stays finite there can end on it.
            averaged = energy.faces.form != "tan" and energy.faces.director_length is None
            result = RESULTS.where(folded, RESULTS.hinge_folded if averaged else RESULTS.hinge_pressed, result)
        return Equilibrium(
            mesh=self.mesh,
            rest=self.rest_shape(),
            vertices=vertices,
            directors=directors,
            reactions=reactions,
            moments=moments,
            multipliers=multipliers,
            energy=end.value,
            gradient_norm=jnp.linalg.norm(end.gradient),
            steps=end.steps,
            factorisations=end.factorisations,
            converged=converged,
            stable=end.stable,
            result=result,
            worst_hinge=worst_hinge,
        )

    def objective(self, start: Equilibrium | None = None) -> tuple[Scalar, tuple[dict[str, Scalar], Equilibrium]]:
        """The loss, with its terms by name and the equilibrium that they were measured at: what [`shellkit.fit`][]
        trains on.

        **Arguments:**

        - `start`: an equilibrium to start the relaxation from; by default the surface at rest.

        **Raises:** `ValueError` if there is no loss.
        """
        if self.loss is None:
            raise ValueError("This InverseProblem has no loss: give it one, such as loss=sk.VertexDistance(target).")
        equilibrium = self(start) if self.loss.needs_shape else self.unrelaxed()
        value, terms = self.loss.evaluate(equilibrium, self.actuation)
        return value, (terms, equilibrium)

    def evaluate(self) -> tuple[Scalar, dict[str, Scalar]]:
        """The loss of the relaxed shell, and the unweighted value of each of its terms by name; a `ValueError` if there
        is none."""
        value, (terms, _) = self.objective()
        return value, terms

    def residuals(self, equilibrium: Equilibrium) -> Float[Array, " m"]:
        """The numbers whose squares sum to the loss, at an equilibrium of this problem that was found before: what
        [`shellkit.fit`][] trains on with a least-squares solver.

        Nothing is relaxed. The first derivative, in any array of the problem, goes through the equilibrium; the Hessian
        is factorised once, and each product with the Jacobian (`jax.linearize`) or its transpose
        (`jax.linear_transpose`) is then one sweep. Second derivatives would be wrong.

        **Arguments:**

        - `equilibrium`: of this problem at its present arrays, as `objective` returns it.

        **Raises:** `ValueError` if there is no loss, or if it is no sum of squares; the message names what is not.
        """
        if self.loss is None:
            raise ValueError("This InverseProblem has no loss: give it one, such as loss=sk.VertexDistance(target).")
        if self.loss.needs_shape:
            energy = self.discrete_energy()
            y = self.assembly.restrict(self.assembly.join(equilibrium.vertices, equilibrium.directors))
            motions = None if self.motions is None else _stop(self.motions)
            multipliers = equilibrium.multipliers
            if multipliers is None:
                y = responding_minimum(energy, y, motions, self.linear_solver())
            else:
                z, m = jnp.concatenate([y, multipliers]), len(multipliers)
                solver = BorderedSolver(self.linear_solver())
                z = responding_minimum(Stationary(energy), z, padded(motions, m), solver)
                y, multipliers = z[:-m], z[-m:]
                energy = energy.held_by(multipliers)
            equilibrium = eqx.tree_at(
                lambda e: (e.vertices, e.directors, e.reactions, e.moments, e.multipliers, e.rest, e.mesh),
                equilibrium,
                (*self.posed(energy, y), multipliers, self.rest_shape(), self.mesh),
                is_leaf=lambda x: x is None,
            )
        else:
            equilibrium = self.unrelaxed()
        found = self.loss.residuals(equilibrium, self.actuation)
        if found is None:
            other = [term.name for term in self.loss.terms_without_residuals(equilibrium, self.actuation)]
            raise ValueError(
                f"The loss is no sum of squares: {', '.join(other)} gives no residuals. Make it a LeastSquaresLoss, or "
                "train with an optax optimiser."
            )
        return found

    def unrelaxed(self) -> Equilibrium:
        """The surface at rest as an equilibrium that nothing was done to: for losses that do not look at the shape."""
        zero, none, yes = jnp.zeros(()), jnp.zeros((), jnp.int32), jnp.array(True)
        return Equilibrium(
            mesh=self.mesh,
            rest=self.rest_shape(),
            vertices=self.mesh.vertices,
            directors=None,
            reactions=None,
            moments=None,
            multipliers=None,
            energy=zero,
            gradient_norm=zero,
            steps=none,
            factorisations=none,
            converged=yes,
            stable=yes,
            result=RESULTS.successful,
            worst_hinge=None,
        )

    def citation(self) -> str:
        """The papers behind the parts in use, as BibTeX: print it. Each part names its own in its class attribute
        `papers`, and so may yours.

        ??? example

            ```python
            class MyEnergy(sk.EnergyTerm):
                papers = ("@article{me2026mine, author = {…}, title = {…}, year = {2026}}",)
            ```
        """
        return citation(self)

    def at(self, progress: float | Scalar) -> "InverseProblem":
        """This problem with a fraction `progress` (0 to 1) of its actuation, loads and prescribed motion; see
        [`shellkit.relax`][]."""
        supports = None if self.supports is None else self.supports.at(progress)
        parts = (self.actuation.at(progress), self.energy.at(progress), supports)
        return eqx.tree_at(lambda p: (p.actuation, p.energy, p.supports), self, parts, is_leaf=lambda x: x is None)

    def linear_solver(self) -> AbstractSparseSolver:
        """What solves the sparse systems behind derivatives and modes: that of [`shellkit.SparseNewton`][], or the best
        one installed where another minimiser relaxes the shell."""
        return self.solver.linear_solver if isinstance(self.solver, SparseNewton) else default_direct_solver()

    def posed(
        self, energy: DiscreteEnergy, y: Float[Array, " n"]
    ) -> tuple[Array, Array | None, Array | None, Array | None]:
        """What [`shellkit.Equilibrium`][] reports of a shape: positions, directors, reactions and moments.

        Of a free shell the pose is that nearest to the surface at rest, with no net translation or rotation.

        **Arguments:**

        - `energy`: as `discrete_energy` returns it.
        - `y`: the vector of free unknowns.

        **Returns:** vertices; directors, in radians; reactions; moments. Each of the last three may be `None`.
        """
        vertices, directors = energy.state(y)
        reactions, moments = None, energy.held_moments(y)
        if self.assembly.free is not None:
            held = energy.full_gradient(y).at[self.assembly.free].set(0.0)
            reactions, _ = self.assembly.split_forces(held)
        if self.motions is not None and self.motions.all_rigid:
            # The pose is that nearest to the start: no net translation or rotation of the displacement.
            vertices = Kabsch()(vertices, self.mesh.vertices)
        return vertices, directors, reactions, moments

    def _step_limit(self) -> int:
        if self.max_steps is not None:
            return self.max_steps
        return self.solver.max_steps if isinstance(self.solver, SparseNewton) else _STEPS_OF_FIRST_ORDER_METHODS


@eqx.filter_jit
def _relax(problem: InverseProblem, start: Equilibrium | None) -> Equilibrium:
    return problem._relaxed(start)


def _stop(tree):
    return jax.tree.map(lambda leaf: jax.lax.stop_gradient(leaf) if eqx.is_inexact_array(leaf) else leaf, tree)


def _checked_thickness(thickness: float | Array, mesh: Mesh) -> Array:
    thickness = jnp.asarray(thickness, dtype=float)
    if thickness.shape not in ((), (mesh.n_faces,)):
        raise ValueError(
            f"InverseProblem: thickness has shape {thickness.shape}; give one number or one a face, "
            f"shape ({mesh.n_faces},)."
        )
    if not isinstance(thickness, Tracer):
        numbers = np.atleast_1d(np.asarray(thickness))
        bad = np.flatnonzero(~(np.isfinite(numbers) & (numbers > 0)))
        if len(bad):
            where = f" of face {bad[0]}" if numbers.size > 1 else ""
            raise ValueError(
                f"InverseProblem: the thickness{where} is {numbers[bad[0]]}; it must be positive and finite."
            )
    return thickness


def _check_constraints(energy: AbstractEnergy, solver: optx.AbstractMinimiser) -> None:
    for weight, term in energy.weighted_terms():
        if not isinstance(term, Constraint):
            continue
        name = type(term).__name__
        if not isinstance(solver, SparseNewton):
            raise ValueError(
                f"{name}: the multiplier of a constraint is found by SparseNewton only, not by {type(solver).__name__}."
            )
        if weight is not None:
            raise ValueError(f"{name}: a constraint has no weight; give it a stiffness, or leave the weight out.")


def _check_one_curvature(terms) -> None:
    """All bending terms of a sum measure one curvature: they share the rest shape and the edge normals."""
    bending = [term for term in terms if isinstance(term, FormEnergy) and term.form is not None]
    kinds = {(term.form, term.directors) for term in bending}
    if len(kinds) > 1:
        listed = "; ".join(f"form={form!r}, directors={directors!r}" for form, directors in sorted(kinds))
        raise ValueError(
            f"The bending terms of the energy measure curvature in different ways ({listed}); give all the same."
        )
