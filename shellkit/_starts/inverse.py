"""Designs to start from: the two layers that make a target exactly, and the nematic ones that come nearest to them."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._actuation import Bilayer, Nematic, PrescribedMetric
from .._geometry.forms import CurvatureForm
from .._mesh.mesh import Mesh
from .layers import eigen, impossible, layer_metrics


_LEAST = 1e-3  # of the larger squared stretch: what the smaller is taken for where it would have to be negative


def bilayer_inverse(
    mesh: Mesh, target: Float[Array, "V 3"], thickness: float | Array, form: CurvatureForm = "sin"
) -> Bilayer:
    r"""The bilayer that takes a target shape without any energy.

    $$g_{t,b} = g \pm \tfrac{2h}{3} (b - b_0),$$

    with the forms $g$, $b$ of the target and $b_0$ of the mesh. Any shape with the mesh's connectivity can be had as
    long as the thickness times the largest change of curvature stays below 3/2, if the material of the layers can grow
    as it must: ask [`shellkit.feasibility`][]. The target is then an equilibrium; it is stable unless another shape has
    nearly the same forms.

    **Arguments:**

    - `mesh`: the surface at rest.
    - `target`: where each vertex should go. Its pose does not matter.
    - `thickness`: of the shell, one number or one per face.
    - `form`: how the energy's bending term measures curvature.

    **Returns:**

    A [`shellkit.Bilayer`][] of two [`shellkit.PrescribedMetric`][].

    **Raises:**

    `ValueError` if the target does not fit the mesh, or some face would have to bend too sharply.

    ??? cite "Source"

        W. van Rees, E. Vouga and L. Mahadevan, "Growth patterns for shape-shifting elastic bilayers", PNAS 114 (2017),
        11597, equation 6.
    """
    metrics = layer_metrics(mesh, target, thickness, form)
    bad = impossible(metrics)
    if len(bad):
        worst = int(jnp.argmax(metrics.bend))
        raise ValueError(
            f"bilayer_inverse: {len(bad)} of {mesh.n_faces} faces would have to bend too sharply for their thickness, "
            f"most of all face {worst}, where thickness times curvature is {float(metrics.bend[worst]):.3g}; it must "
            "stay below 1.5. Take a thinner shell, a smoother target or a finer mesh."
        )
    return Bilayer(top=PrescribedMetric(metrics.top), bottom=PrescribedMetric(metrics.bottom))


def nematic_start(
    mesh: Mesh,
    target: Float[Array, "V 3"],
    thickness: float | Array,
    stretch: float | Array | None = None,
    form: CurvatureForm = "sin",
) -> Bilayer:
    r"""The nematic bilayer nearest to the one that makes a target exactly: a start for training.

    Each layer of [`shellkit.bilayer_inverse`][] asks for squared stretches $c_1 \ge c_2$ along two axes. A nematic
    layer keeps its area, so it cannot do all of that. The nearest that it can do, in the distance of logarithms of
    metrics, has its director along the first axis and the stretch $\lambda = (c_1/c_2)^{1/4}$; a given stretch below
    one needs the second axis.

    What is lost is the area: expect a shape that bends the right way and is too small or too large in places. Where
    $c_1 = c_2$ any angle is as good as another, and zero is chosen.

    **Arguments:**

    - `mesh`: the surface at rest.
    - `target`: where each vertex should go. Its pose does not matter.
    - `thickness`: of the shell, one number or one per face.
    - `stretch`: of the material along its director, one number or one per face; by default the best one of each face
        and layer.
    - `form`: how the energy's bending term measures curvature.

    **Returns:**

    A [`shellkit.Bilayer`][] of two [`shellkit.Nematic`][].

    **Raises:**

    `ValueError` if the target does not fit the mesh.

    ??? cite "Source"

        The distance: V. Arsigny, P. Fillard, X. Pennec and N. Ayache, "Log-Euclidean metrics for fast and simple
        calculus on diffusion tensors", Magn. Reson. Med. 56 (2006), 411.
    """
    metrics = layer_metrics(mesh, target, thickness, form)

    def nearest(metric: Float[Array, "F 2 2"]) -> Nematic:
        values, angle = eigen(metrics.rest, metric)
        larger = jnp.maximum(values[:, 0], 1e-300)
        smaller = jnp.maximum(values[:, 1], _LEAST * larger)
        angle = jnp.where(larger - smaller > 1e-12 * larger, angle, 0.0)
        if stretch is None:
            return Nematic(angle, (larger / smaller) ** 0.25)
        given = jnp.asarray(stretch, dtype=float)
        return Nematic(jnp.where(given < 1, angle + 0.5 * jnp.pi, angle), given)

    return Bilayer(top=nearest(metrics.top), bottom=nearest(metrics.bottom))
