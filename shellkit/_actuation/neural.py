"""Directors as a function of place: a network that is evaluated where the faces are."""

from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._citation.papers import AHARONI_2014, SITZMANN_2020
from .._geometry.surface import face_frames
from .._mesh.mesh import Mesh
from .base import SheetActuation
from .nematic import Nematic


_UNIFORM = 1e-24  # the square of an order parameter below which there is no direction


class NeuralDirectors(SheetActuation):
    r"""A nematic sheet whose directors are a function of place, such as a coordinate network: it has as many weights on
    a coarse mesh as on a fine one, and goes from one to the other as it is.

    At the centre $x$ of each face the field gives the six numbers of a symmetric tensor $Q(x)$. Its part in the plane
    of the face, less the trace, is $q\,(2\,n n^T - 1)$ with the director $n$: turning a director by half a turn is the
    same tensor, so the field is continuous where an angle would jump. Only the direction counts, not $q$.

    ??? example

        ```python
        network = eqx.nn.MLP(3, 6, width_size=32, depth=2, activation=jnp.sin, key=jax.random.key(0))
        problem = sk.InverseProblem(mesh, 0.05, energy, sk.NeuralDirectors(network, stretch=0.9), loss)
        result = sk.fit(problem, optax.adam(1e-2), steps=200, where=lambda p: p.actuation.field)
        finer = result.problem.replace(mesh=fine_mesh, loss=loss_on(fine_mesh))
        ```

    When not to use it: for patterns with defects or jumps that a smooth field cannot have, train the angle of each face
    of a [`shellkit.Nematic`][].

    ??? cite "Source"

        Directors as in [`shellkit.Nematic`][]. Networks of sines as fields: V. Sitzmann et al., "Implicit neural
        representations with periodic activation functions", NeurIPS (2020).
    """

    papers: ClassVar[tuple[str, ...]] = (AHARONI_2014, SITZMANN_2020)
    field: Callable[[Float[Array, "3"]], Float[Array, "6"]]
    stretch: Float[Array, "..."]
    length: float = eqx.field(static=True)

    def __init__(self, field: Callable[[Array], Array], stretch: float | Array, length: float = 1.0):
        """**Arguments:**

        - `field`: from a place, in units of `length`, to the numbers 11, 22, 33, 23, 31, 12 of $Q$; a module, whose
            weights are trained.
        - `stretch`: along the director, one number or one per face.
        - `length`: the unit of places, in the unit of the mesh: about the size of the surface.

        **Raises:** `ValueError`, when a problem is built, if the field does not give six numbers.
        """
        self.field = field
        self.stretch = jnp.asarray(stretch, dtype=float)
        self.length = float(length)

    def check(self, mesh: Mesh) -> None:
        found = eqx.filter_eval_shape(self.field, jnp.zeros(3))
        if getattr(found, "shape", None) != (6,):
            raise ValueError(
                f"NeuralDirectors: the field gives {getattr(found, 'shape', type(found).__name__)} at a place; it must "
                "give six numbers, shape (6,): those of a symmetric tensor."
            )
        if not self.length > 0:
            raise ValueError(f"NeuralDirectors: length is {self.length}; it must be positive.")
        Nematic(jnp.zeros(mesh.n_faces), self.stretch).check(mesh)

    def on(self, mesh: Mesh) -> Nematic:
        """The directors of the faces of a mesh."""
        return Nematic(self.angles(mesh), self.stretch)

    def angles(self, mesh: Mesh) -> Float[Array, " F"]:
        """The angle of the director in each face, in radians from its first edge.

        **Arguments:**

        - `mesh`: any mesh.
        """
        return _angles(self.field, self.length, mesh)

    def actuated_metric(self, metric: Float[Array, "F 2 2"]) -> Float[Array, "F 2 2"]:
        raise ValueError(
            "NeuralDirectors is a function of place, and a metric does not say where its faces are: use on(mesh) first."
        )

    def at(self, progress: float | Float[Array, ""]) -> "NeuralDirectors":
        """Slow heating: the stretch grows from 1 to its full value."""
        return eqx.tree_at(lambda sheet: sheet.stretch, self, 1 + progress * (self.stretch - 1))


@eqx.filter_jit
def _angles(field: Callable[[Array], Array], length: float, mesh: Mesh) -> Float[Array, " F"]:
    centres = jnp.mean(mesh.vertices[mesh.faces], axis=1) / length
    q11, q22, q33, q23, q31, q12 = jax.vmap(field)(centres).T
    rows = [jnp.stack(row, axis=-1) for row in ((q11, q12, q31), (q12, q22, q23), (q31, q23, q33))]
    tensors = jnp.stack(rows, axis=-2)
    e1, e2 = face_frames(mesh.vertices, mesh)
    along = lambda a, b: jnp.einsum("fi,fij,fj->f", a, tensors, b)
    even, odd = along(e1, e1) - along(e2, e2), 2 * along(e1, e2)
    # Where the tensor has no direction in the plane of a face, the angle has no derivative: it is zero there.
    directed = even**2 + odd**2 > _UNIFORM
    return 0.5 * jnp.arctan2(jnp.where(directed, odd, 0.0), jnp.where(directed, even, 1.0))
