"""What an equilibrium costs where, and how the sheet is stressed there: energy and membrane stress face by face."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._energy import Terms
from .._equilibrium import Equilibrium
from .._geometry.forms import Components, components, determinant, first_form, second_form
from .._problem.problem import InverseProblem


def energy_density(problem: InverseProblem, equilibrium: Equilibrium) -> Float[Array, " F"]:
    r"""The elastic energy of each face over its actuated rest area: where a shell is frustrated.

    Terms that are functions of the forms of a face count ([`shellkit.FormEnergy`][]: stretching and bending); what
    belongs to edges or vertices (hinges, springs, loads) does not.

    **Arguments:**

    - `problem`: what the equilibrium is one of, for its energy.
    - `equilibrium`: the shape.

    **Returns:** an array of shape `(F,)`, in units of pressure times length. Times the rest areas
    $\tfrac12\sqrt{\det g_r}$ it sums to the energy of those terms.
    """
    metric, curvature = _forms(problem, equilibrium)
    return _energies(problem, equilibrium, metric, curvature) / _areas(components(equilibrium.rest.metric))


def membrane_stress(problem: InverseProblem, equilibrium: Equilibrium) -> Float[Array, "F 2 2"]:
    r"""The stress in the sheet, averaged over its thickness, in each face.

    $$\sigma = \frac{2}{A h} B\, \frac{\partial E_f}{\partial g}\, B^T, \qquad g = B^T B,$$

    the derivative of the energy of the face in its metric, at constant curvature form, over the relaxed area $A$ and
    the thickness at rest $h$: forces in the relaxed shape, times $h$ per length of a cut. Bending adds stresses that
    cancel over the thickness; they are not in it. Terms count as for [`shellkit.energy_density`][].

    **Arguments:**

    - `problem`: what the equilibrium is one of, for its energy.
    - `equilibrium`: the shape.

    **Returns:** an array of shape `(F, 2, 2)` in units of pressure, tension positive, in the frames
    [`shellkit.face_frames`][]`(equilibrium.vertices, mesh)`.

    ??? cite "Source"

        The formula of T. C. Doyle and J. L. Ericksen, "Nonlinear elasticity", Advances in Applied Mechanics 4 (1956),
        53–115, for a sheet.
    """
    metric, curvature = _forms(problem, equilibrium)
    # The off-diagonal component stands twice in the metric.
    energies = lambda *g: _energies(problem, equilibrium, g, curvature)
    value, pull_back = jax.vjp(energies, *metric)
    e11, e12, e22 = pull_back(jnp.ones_like(value))
    e12 = 0.5 * e12
    length = jnp.sqrt(metric[0])
    shift, height = metric[1] / length, jnp.sqrt(determinant(metric)) / length
    scale = 2 / (_areas(metric) * equilibrium.rest.thickness)
    s11 = length**2 * e11 + 2 * length * shift * e12 + shift**2 * e22
    s12 = height * (length * e12 + shift * e22)
    s22 = height**2 * e22
    rows = jnp.stack([jnp.stack([s11, s12], axis=-1), jnp.stack([s12, s22], axis=-1)], axis=-2)
    return scale[:, None, None] * rows


def _forms(problem: InverseProblem, equilibrium: Equilibrium) -> tuple[Components, Components | None]:
    """The metric of the relaxed shape, and its curvature as the energy measures it; `None` where nothing bends."""
    vertices, mesh, directors = equilibrium.vertices, equilibrium.mesh, equilibrium.directors
    form = Terms.of(problem.energy).form
    curvature = None if form is None else components(second_form(vertices, mesh, form, directors))
    return components(first_form(vertices, mesh)), curvature


def _energies(
    problem: InverseProblem, equilibrium: Equilibrium, metric: Components, curvature: Components | None
) -> Float[Array, " F"]:
    total = jnp.zeros(equilibrium.mesh.n_faces)
    for weight, term in Terms.of(problem.energy).faces:
        data = term.element_data(equilibrium.mesh, equilibrium.rest)
        energy = term.density(metric, None if term.form is None else curvature, data)
        total = total + (energy if weight is None else weight * energy)
    return total


def _areas(metric: Components) -> Float[Array, " F"]:
    return 0.5 * jnp.sqrt(determinant(metric))
