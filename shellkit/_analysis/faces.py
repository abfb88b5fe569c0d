"""What an equilibrium costs where, and how the sheet is stressed there: energy and membrane stress face by face."""

from jaxtyping import Array, Float

from .._equilibrium import Equilibrium
from .._fields.stress import density_of, stress_of
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
    at = equilibrium
    return density_of(problem.energy, at.mesh, at.rest, at.vertices, at.directors)


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
    at = equilibrium
    return stress_of(problem.energy, at.mesh, at.rest, at.vertices, at.directors)
