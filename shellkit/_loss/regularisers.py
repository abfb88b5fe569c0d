"""Losses that ask for no shape but keep a design sane: smooth director fields, and no folds."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._actuation.base import Actuation
from .._citation.papers import CLAUSSEN, GRINSPUN_2003
from .._equilibrium import Equilibrium
from .._geometry.curvature import dihedral_angles
from .._geometry.directors import directors
from .._geometry.rowwise import over, root
from .._geometry.surface import edge_lengths, face_areas
from .._mesh.mesh import Mesh
from .base import LeastSquaresLoss


class DirectorSmoothness(LeastSquaresLoss):
    r"""How much the actuation's directors turn from face to face, as headless lines in space.

    The mean over interior edges of $|Q_f - Q_{f'}|^2$ with $Q = d \otimes d - I/2$ and $d$ the director on the
    surface at rest, summed over the layers of the actuation. $Q$ is smooth in the angle and does not know a
    director's head from its tail. On a curved surface it cannot vanish: the surface's own turning counts. Looks at no
    relaxed shape, so that it needs no relaxation.

    **Returns:**

    When called, a scalar without unit; at most 2 a layer.

    **Raises:**

    `ValueError`, when checked, for an actuation without directors.

    ??? cite "Source"

        The regulariser of the inverse-design tutorial of N. Claussen's `triangulax`; $Q$ is the order parameter of
        P. G. de Gennes and J. Prost, "The physics of liquid crystals" (2nd edition, 1993), section 2.1.
    """

    papers: ClassVar[tuple[str, ...]] = (CLAUSSEN,)

    def residuals(self, equilibrium: Equilibrium, actuation: Actuation) -> Float[Array, " m"]:
        mesh = equilibrium.mesh
        interior = ~mesh.boundary_edges
        root_share = jnp.where(interior, 1.0, 0.0) / jnp.sqrt(jnp.sum(interior))
        first, second = mesh.edge_faces[:, 0], mesh.edge_faces[:, 1]
        jumps = []
        for angles in actuation.director_fields():
            q = _outer_product(directors(mesh, angles))
            jumps.append((root_share[:, None] * (q[first] - q[second])).ravel())
        return jnp.concatenate(jumps)

    def check(self, mesh: Mesh, actuation: Actuation) -> None:
        if not actuation.director_fields():
            raise ValueError(
                f"DirectorSmoothness: the actuation {type(actuation).__name__} has no directors; use it with Nematic, "
                "OrthotropicGrowth or a Bilayer of them, or leave this loss out."
            )
        if mesh.n_edges == 3 * mesh.n_faces:
            raise ValueError(
                "DirectorSmoothness: no two faces of the mesh share an edge, so that there is nothing to smooth."
            )

    @property
    def sees_motion(self) -> bool:
        return False

    @property
    def needs_shape(self) -> bool:
        return False


class FoldPenalty(LeastSquaresLoss):
    r"""The bending energy of the hinges of the relaxed surface, measured from flat: large where an edge is folded.

    $\sum_e \frac{\ell_e^2}{A_e} \theta_e^2$ over the interior edges, with $\theta_e$ the dihedral angle and $A_e =
    (A_f + A_{f'}) / 3$, after Grinspun, Hirani, Desbrun and Schröder (2003), section 3, all on the relaxed surface.
    It does not change with the size of the shape; on a sphere it tends to a constant, not to zero, as the mesh is
    refined. Smooth up to hinges folded to 180°, where the dihedral angle jumps.

    **Returns:**

    When called, a scalar without unit.

    ??? cite

        ```bibtex
        @inproceedings{grinspun2003discrete,
            author = {Grinspun, Eitan and Hirani, Anil N. and Desbrun, Mathieu and Schr{\"o}der, Peter},
            title = {Discrete shells},
            booktitle = {Proceedings of the 2003 ACM SIGGRAPH/Eurographics Symposium on Computer Animation},
            year = {2003},
        }
        ```
    """

    papers: ClassVar[tuple[str, ...]] = (GRINSPUN_2003,)

    def residuals(self, equilibrium: Equilibrium, actuation: Actuation) -> Float[Array, " m"]:
        vertices, mesh = equilibrium.vertices, equilibrium.mesh
        face_area = face_areas(vertices, mesh)
        area = (face_area[mesh.edge_faces[:, 0]] + face_area[mesh.edge_faces[:, 1]]) / 3
        # Boundary edges drop out, since their angle is zero.
        return over(edge_lengths(vertices, mesh), root(area)) * dihedral_angles(vertices, mesh)

    @property
    def sees_motion(self) -> bool:
        return False


def _outer_product(d: Float[Array, "F 3"]) -> Float[Array, "F 6"]:
    r"""Six numbers whose squares sum to $|d \otimes d|^2$: off the diagonal, one of each equal pair, times $\sqrt
    2$."""
    return d[:, (0, 1, 2, 0, 0, 1)] * d[:, (0, 1, 2, 1, 2, 2)] * np.sqrt((1.0, 1.0, 1.0, 2.0, 2.0, 2.0))
