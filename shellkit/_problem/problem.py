"""The inverse problem: a surface, what actuates it, what deformation costs, and what shape is wanted."""

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float, Scalar

from .._actuation import Actuation, Passive
from .._citation.gather import citation
from .._citation.papers import BRADBURY_2018, KIDGER_2021, RADER_2024
from .._energy import AbstractEnergy, Assembly, DiscreteEnergy, Terms, Unknowns
from .._equilibrium import Diagnostics, Equilibrium, Pose
from .._loss import Loss
from .._mesh.mesh import Mesh
from .._programs.batching import in_turn
from .._programs.precision import require_x64
from .._programs.tracing import frozen, is_traced, is_tracing, with_parts
from .._relaxation.forward import assess, near, pose_of, relax, respond
from .._relaxation.relaxed import Relaxed, Start
from .._relaxation.rigid_modes import RigidModes, rigid_modes
from .._rest import RestShape, checked_rest_lengths
from .._solve.linear.base import AbstractSparseSolver
from .._solve.linear.choose import default_linear_solver
from .._solve.matrices.operator import SparseSymmetric
from .._solve.newton.newton import SparseNewton
from .._supports import Supports
from .checks import check_constraints, check_loss, check_one_curvature, checked_thickness, refuse_held_moments
from .origin import Origin


_STEPS_OF_FIRST_ORDER_METHODS = 10_000


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
    origin: Origin  # what the numbering was made from

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
        - `thickness`: of the shell, one number or one per face, in the unit of the mesh.
        - `energy`: what deformation costs; a sum of terms.
        - `actuation`: what the shell would like to become; by default it stays as it is.
        - `loss`: what is wanted of the equilibrium; only `evaluate` needs it.
        - `solver`: any minimiser of optimistix; by default [`shellkit.SparseNewton`][].
        - `max_steps`: of the minimiser; by default its own limit, or 10,000 for one that has none. Where `SparseNewton`
            begins with plain steps and these get stuck, it has as many again.
        - `supports`: what is held, such as [`shellkit.Clamped`][]; by default nothing. Which vertices they hold, and in
            which directions, is settled here; where they hold them can be changed and trained.
        - `rest_lengths`: `"own"`, each face has its rest metric as the actuation gives it, or `"shared"`, both faces of
            an edge have the same rest length along it: far more accurate for samples of a smooth field of directors or
            growth, see [`shellkit.RestShape`][].

        **Raises:** `ValueError` if a part does not fit the mesh or the other parts; the message says what to change.
        """
        require_x64("InverseProblem")
        self.mesh = mesh
        self.thickness = checked_thickness(thickness, mesh)
        self.actuation = Passive() if actuation is None else actuation
        self.supports = None if supports is None else supports.on(mesh)
        self.loss = loss
        self.solver = SparseNewton() if solver is None else solver
        self.max_steps = max_steps
        self.rest_lengths = checked_rest_lengths(rest_lengths)
        for _, term in energy.weighted_terms():
            term.check(mesh)
        self.energy = energy.on(mesh)
        if self.supports is not None:
            self.supports.check(mesh)
            refuse_held_moments(self.energy, [part.held_edges(mesh) for part in self.supports.parts()], mesh)
        self._check_parts()
        self.assembly = Assembly.of(self.energy, mesh, self.supports)
        self.origin = Origin.of(mesh, self.energy, self.supports)

    def _check_parts(self) -> None:
        """What can be wrong with parts that may be swapped by `tree_at`: asked when a problem is built, and again
        whenever a program is traced for it."""
        if self.thickness.shape not in ((), (self.mesh.n_faces,)):
            checked_thickness(self.thickness, self.mesh)
        self.actuation.check(self.mesh)
        check_constraints(self.energy, self.solver)
        check_one_curvature(self.energy)
        if self.loss is not None:
            check_loss(self.loss, self.mesh, self.actuation.on(self.mesh))

    def replace(self, **parts: Any) -> "InverseProblem":
        """This problem built anew with other parts, given by the names that they have when a problem is built.

        Arrays can be changed by `equinox.tree_at`, and so can actuation, loss and solver as a whole. Connectivity, the
        kinds of terms of the energy, and what supports hold decide which unknowns there are: these parts are replaced
        here.

        ??? example

            ```python
            stiffer = problem.replace(energy=problem.energy + sk.Gravity(1.0))
            ```
        """
        names = ("mesh", "thickness", "energy", "actuation", "loss", "solver", "max_steps", "supports", "rest_lengths")
        unknown = [name for name in parts if name not in names]
        if unknown:
            raise ValueError(f"InverseProblem.replace: there is no part {unknown[0]!r}; parts are {', '.join(names)}.")
        return InverseProblem(**{name: parts.get(name, getattr(self, name)) for name in names})

    def rest_shape(self) -> RestShape:
        """The rest shape under actuation.

        **Raises:** `ValueError` if parts were swapped that do not fit, or that the problem was not built for; the
        message says how to replace them.
        """
        self.origin.check(self.mesh, self.energy, self.supports)
        self._check_parts()
        form = Terms.of(self.energy).form
        beyond = None if self.supports is None or form is None else self.supports.at(0.0).continuation(self.mesh)
        rest = RestShape.of(self.mesh, self.thickness, form, beyond)
        actuated = self.actuation.on(self.mesh)(rest)
        shared = self.rest_lengths == "shared" and not isinstance(self.actuation, Passive)
        return actuated.sharing_edges(self.mesh) if shared else actuated

    def discrete_energy(self) -> DiscreteEnergy:
        """The energy as a function of the vector of free unknowns, with its gradient and sparse Hessian."""
        return self.energy_of(self.rest_shape())

    def energy_of(self, rest: RestShape) -> DiscreteEnergy:
        """What `discrete_energy` returns, for a rest shape that is at hand."""
        held, beyond = self.mesh.vertices, None
        if self.supports is not None:
            held, beyond = self.supports.held_positions(self.mesh), self.supports.continuation(self.mesh)
        held = self.assembly.dofs.pack(Unknowns(held))
        return DiscreteEnergy(self.energy, self.mesh, rest, self.assembly, held, beyond)

    def rigid_modes(self, energy: DiscreteEnergy | None = None) -> RigidModes | None:
        """The rigid motions that cost nothing, with supports and loads as they are now; `None` if there is none.

        **Arguments:**

        - `energy`: as `discrete_energy` returns it, if it is at hand.
        """
        most = self.origin.most_rigid_modes
        if most == 0:
            return None
        energy = self.discrete_energy() if energy is None else energy
        return rigid_modes(energy, self.mesh, self.supports, most)

    def total_energy(self, vertices: Float[Array, "V 3"], directors: Float[Array, " E"] | None = None) -> Scalar:
        """The energy of any shape, in units of pressure times volume; held vertices are where they are held.

        **Arguments:**

        - `vertices`: positions, in the unit of the mesh.
        - `directors`: angles by which edge normals are turned, where directors are free; by default zero.
        """
        return self.discrete_energy()(self.assembly.dofs.gather(Unknowns(vertices, directors)))

    def hessian(self, vertices: Float[Array, "V 3"], directors: Float[Array, " E"] | None = None) -> SparseSymmetric:
        """The Hessian of the energy at any shape, a sparse lineax operator that acts on fields like `vertices`.

        Where directors are free it acts on pairs `(vertices, directors)`; where supports hold something, on the flat
        vector of the unknowns that are left. `vertices` and `directors` are as for `total_energy`.

        **Raises:** `ValueError` where the energy has constraints: what they add is dense.
        """
        if Terms.of(self.energy).constraints:
            raise ValueError("The Hessian of an energy with constraints is not sparse; take the constraints out of it.")
        dofs = self.assembly.dofs
        flat = self.discrete_energy().hessian(dofs.gather(Unknowns(vertices, directors)))
        assert isinstance(flat, SparseSymmetric)
        values = flat.values
        if dofs.director_length is not None:
            # Derivatives in angles, from those in the unknowns of a relaxation.
            angles = dofs.per_unknown(jnp.ones(self.mesh.n_vertices), dofs.director_length)
            values = values * angles[flat.pattern.rows] * angles[flat.pattern.indices]
        return SparseSymmetric(flat.pattern, values, like=dofs.like(vertices.dtype))

    def __call__(self, start: Equilibrium | Start | None = None) -> Equilibrium:
        """Relax the shell.

        **Arguments:**

        - `start`: an equilibrium to start from; by default the surface at rest, which is what an experiment does.

        **Returns:** the [`shellkit.Equilibrium`][]. A relaxation that fails returns what it has, with the reason in
        `result`.
        """
        found = self.relaxed(start)
        if not is_traced(self):
            return Equilibrium.of(self.mesh, found.rest, found.pose, found.found)
        return self.responding(found)

    def relaxed(self, start: Equilibrium | Start | None = None) -> Relaxed:
        """The relaxation alone, of which nothing is differentiated: one compiled program for all problems of a kind,
        whatever their loss, and whoever calls it.

        **Arguments:**

        - `start`: as when the problem is called.
        """
        bare, begin, plain = self.asked(start)
        if plain:
            found = relax(bare, begin, True)
            return relax(bare, found.start, False).after(found.found) if found.stuck else found
        arguments = frozen((bare, begin))
        return (in_turn(relax) if is_traced(arguments) else relax)(*arguments, False)

    def asked(self, start: Equilibrium | Start | None = None) -> tuple["InverseProblem", Start, bool]:
        """What the program of a relaxation is handed: the problem without its loss, which has no part in it; where to
        begin; and whether plain steps will do at first.

        **Arguments:**

        - `start`: as when the problem is called.
        """
        self.origin.check(self.mesh, self.energy, self.supports)
        bare, begin = with_parts(self, loss=None), Start.of(self.mesh, self.assembly, start)
        # Few relaxations need all that the solver can do, which takes long to compile: they go on with it.
        plain = isinstance(self.solver, SparseNewton) and begin.multipliers is None
        return bare, begin, plain and not is_traced((bare, begin)) and not is_tracing()

    def responding(self, found: Relaxed) -> Equilibrium:
        """The equilibrium that was found, as a function of every array of the problem: with its derivative there.

        **Arguments:**

        - `found`: what `relaxed` returned for this problem at its present arrays.
        """
        bare = with_parts(self, loss=None)
        rest, pose = respond(bare, frozen(found), posed=True)
        return Equilibrium.of(self.mesh, rest, pose, frozen(found.found))

    @property
    def needs_shape(self) -> bool:
        """Whether the loss looks at the relaxed shape; without a loss there is nothing that does."""
        return self.loss is not None and self.loss.needs_shape

    def objective(self, start: Equilibrium | None = None) -> tuple[Scalar, tuple[dict[str, Scalar], Equilibrium]]:
        """The loss, with its terms by name and the equilibrium that they were measured at: what [`shellkit.fit`][]
        trains on.

        **Arguments:**

        - `start`: an equilibrium to start the relaxation from; by default the surface at rest.

        **Raises:** `ValueError` if there is no loss.
        """
        return self._assessed(self(start) if self.needs_shape else self.unrelaxed())

    def respond(self, found: Relaxed) -> tuple[Scalar, tuple[dict[str, Scalar], Equilibrium]]:
        """What `objective` returns, from a relaxation that was done before; differentiable all the same.

        **Arguments:**

        - `found`: what `relaxed` returned for this problem at its present arrays.

        **Raises:** `ValueError` if there is no loss.
        """
        if self.loss is None or self.loss.sees_motion or self.supports is not None:
            return self._assessed(self.responding(found))
        # A loss that a rigid motion does not change is spared the derivative of the pose.
        rest, pose = respond(with_parts(self, loss=None), frozen(found), posed=False)
        value, (terms, _) = self._assessed(Equilibrium.of(self.mesh, rest, pose, found.found))
        return value, (terms, Equilibrium.of(self.mesh, rest, found.pose, found.found))

    def _assessed(self, equilibrium: Equilibrium) -> tuple[Scalar, tuple[dict[str, Scalar], Equilibrium]]:
        if self.loss is None:
            raise ValueError("This InverseProblem has no loss: give it one, such as loss=sk.VertexDistance(target).")
        actuation = self.actuation.on(self.mesh)
        check_loss(self.loss, equilibrium.mesh, actuation)
        value, terms = assess(self.loss, equilibrium, actuation)
        return value, (terms, equilibrium)

    def evaluate(self) -> tuple[Scalar, dict[str, Scalar]]:
        """The loss of the relaxed shell, and the unweighted value of each of its terms by name; a `ValueError` if there
        is none."""
        value, (terms, _) = self.objective()
        return value, terms

    def near(self, equilibrium: Equilibrium) -> Equilibrium:
        """An equilibrium of this problem that was found before, as a function of every array of the problem, to first
        order: for many products with its derivative.

        Nothing is relaxed. The Hessian is factorised once, and each product with the Jacobian (`jax.linearize`) or its
        transpose (`jax.linear_transpose`) is then one sweep. Second derivatives would be wrong.

        **Arguments:**

        - `equilibrium`: of this problem at its present arrays.
        """
        rest, pose = near(with_parts(self, loss=None), equilibrium)
        return Equilibrium.of(self.mesh, rest, pose, frozen(equilibrium.diagnostics))

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
        equilibrium = self.near(equilibrium) if self.loss.needs_shape else self.unrelaxed()
        actuation = self.actuation.on(self.mesh)
        found = self.loss.residuals(equilibrium, actuation)
        if found is None:
            other = [term.name for term in self.loss.terms_without_residuals(equilibrium, actuation)]
            raise ValueError(
                f"The loss is no sum of squares: {', '.join(other)} gives no residuals. Make it a LeastSquaresLoss, or "
                "train with an optax optimiser."
            )
        return found

    def unrelaxed(self) -> Equilibrium:
        """The surface at rest as an equilibrium that nothing was done to: for losses that do not look at the shape."""
        rest = Start.of(self.mesh, self.assembly, None)
        pose = Pose(rest.unknowns, multipliers=rest.multipliers)
        return Equilibrium.of(self.mesh, self.rest_shape(), pose, Diagnostics.of_nothing())

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
        return self.solver.linear_solver if isinstance(self.solver, SparseNewton) else default_linear_solver()

    def posed(
        self,
        energy: DiscreteEnergy,
        y: Float[Array, " n"],
        motions: RigidModes | None = None,
        multipliers: Float[Array, " m"] | None = None,
    ) -> Pose:
        """What [`shellkit.Equilibrium`][] reports of a shape; see `pose_of`."""
        return pose_of(self, energy, y, motions, multipliers)

    def step_limit(self) -> int:
        """How many steps the minimiser may take."""
        if self.max_steps is not None:
            return self.max_steps
        return self.solver.max_steps if isinstance(self.solver, SparseNewton) else _STEPS_OF_FIRST_ORDER_METHODS
