"""The distance of two surfaces as varifolds: as clouds of small oriented patches, compared by kernels of several
widths. It needs no correspondences, and is smooth."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float, Scalar

from .._actuation.base import Actuation
from .._align.aligners import Aligner
from .._align.icp import ICP
from .._citation.papers import CHARON_2013, KALTENMARK_2017
from .._equilibrium import Equilibrium
from .._geometry.rowwise import length, over
from .._geometry.surface import edge_vectors
from .._mesh.mesh import Mesh
from .base import Loss
from .surface import checked_target


_ROWS, _COLUMNS = 128, 512  # faces of either side in a block: its few arrays of 500 kB stay in the cache
_WIDTH = 1 / 4  # of the diagonal of the target's bounding box


class Varifold(Loss):
    r"""Squared distance of the relaxed surface and a target in the space of varifolds, relative to the target's own.

    $$\frac1K \sum_{k=1}^K \frac{\langle S, S\rangle_k - 2 \langle S, T\rangle_k + \langle T, T\rangle_k} {\langle T,
    T\rangle_k}, \qquad \langle S, T\rangle_k = \sum_{f \in S} \sum_{f' \in T} e^{-|c_f - c_{f'}|^2 / \sigma_k^2}\,
    \gamma(n_f \cdot n_{f'})\, A_f A_{f'},$$

    with the centroids $c$, unit normals $n$ and areas $A$ of the faces, $\gamma(s) = \bigl(\tfrac{1 + s}2\bigr)^2$
    (oriented) or $s^2$, and widths $\sigma_k = 2^{1 - k} \sigma_1$. A width says how far apart two patches may lie and
    still see each other: large ones guide from afar, small ones show detail. Details and triangles below the least
    width are not seen, and with widths all below the distance of the surfaces there is no gradient. The sum over pairs
    of faces goes in blocks, so that memory stays small; the time grows with the product of the numbers of faces.
    Halves of a width need no further exponentials.

    Smooth everywhere but where a face has no area. The target and the widths are taken as fixed: their derivative is
    zero.

    **Arguments:**

    - `target`: the surface wanted.
    - `width`: the largest, $\sigma_1$, in the vertices' unit; by default a quarter of the diagonal of the target's
        bounding box.
    - `scales`: the number $K$ of widths, each half of the one before.
    - `oriented`: whether the sides of the surface are told apart; if not, faces may be of any orientation, and the two
        sides of a thin part are taken for one.
    - `aligner`: how the relaxed vertices are laid upon the target; by default `ICP(target.faces)`.

    **Returns:**

    When called, a scalar without unit: 0 for the same surface, about 1 for none at all.

    **Raises:**

    `ValueError` for a width that is not a positive number, or no scales; when checked, for an aligner that does not
    fit.

    ??? cite

        N. Charon and A. Trouvé, "The varifold representation of nonoriented shapes for diffeomorphic registration",
        SIAM Journal on Imaging Sciences 6 (2013), 2547, for $\gamma(s) = s^2$; I. Kaltenmark, B. Charlier and N.
        Charon, "A general framework for curve and surface comparison and registration with oriented varifolds", CVPR
        (2017), 4580.
    """

    papers: ClassVar[tuple[str, ...]] = (CHARON_2013, KALTENMARK_2017)

    target: Mesh
    width: Scalar
    squared_norms: Float[Array, " K"]
    oriented: bool = eqx.field(static=True)
    aligner: Aligner

    def __init__(
        self,
        target: Mesh,
        width: ArrayLike | None = None,
        scales: int = 3,
        oriented: bool = True,
        aligner: Aligner | None = None,
    ):
        self.target = checked_target("Varifold", target)
        self.width = _checked_width(width, target)
        if int(scales) != scales or scales < 1:
            raise ValueError(f"Varifold: scales is {scales}; give a whole number, 1 or more.")
        self.oriented = oriented
        self.aligner = ICP(target.faces) if aligner is None else aligner
        self.squared_norms = _squared_norms(_patches(target.vertices, target), self.width, int(scales), oriented)

    def __call__(self, equilibrium: Equilibrium, actuation: Actuation) -> Scalar:
        vertices = self.aligner(equilibrium.vertices, self.target.vertices)
        found, wanted = _patches(vertices, equilibrium.mesh), _patches(self.target.vertices, self.target)
        kernel = _Kernel(self.width, 1 / (self.squared_norms.shape[0] * self.squared_norms), self.oriented)
        still_kernel, still_wanted = jax.lax.stop_gradient((kernel, wanted))
        return _own_product(found, still_kernel) - 2 * _product(found, still_wanted, still_kernel) + 1

    def check(self, mesh: Mesh, actuation: Actuation) -> None:
        jax.eval_shape(lambda: self.aligner(mesh.vertices, self.target.vertices))

    @property
    def sees_motion(self) -> bool:
        return not self.aligner.removes_motion


def _patches(vertices: Float[Array, "V 3"], mesh: Mesh) -> Float[Array, "F 7"]:
    """Centroid, unit normal and area of each face, one face a row."""
    u, v = edge_vectors(vertices, mesh)
    doubled = jnp.cross(u, v)
    size = length(doubled)[:, None]
    centroids = vertices[mesh.faces[:, 0]] + (u + v) / 3
    return jnp.concatenate([centroids, over(doubled, size), size / 2], axis=1)


class _Kernel(eqx.Module):
    """A sum of Gaussians of the distance, times a function of the angle between normals."""

    width: Scalar
    shares: Float[Array, " K"]
    oriented: bool = eqx.field(static=True)

    def gaussian(self, squared: Array) -> Array:
        """The widest Gaussian of squared distances."""
        return jnp.exp(-squared / self.width**2)

    def near(self, gaussian: Array) -> tuple[Array, Array]:
        """The sum of Gaussians, from the widest, and minus its derivative in the squared distances."""
        sharpness = 1 / self.width**2
        total, slope = self.shares[0] * gaussian, self.shares[0] * sharpness * gaussian
        for k in range(1, self.shares.shape[0]):
            gaussian = jnp.square(jnp.square(gaussian))  # half the width: the fourth power
            total += self.shares[k] * gaussian
            slope += self.shares[k] * 4**k * sharpness * gaussian
        return total, slope

    def alike(self, cosine: Array) -> tuple[Array, Array]:
        """The function of the cosine of the angle, and its derivative."""
        half = (1 + cosine) / 2
        return (half**2, half) if self.oriented else (cosine**2, 2 * cosine)


@jax.custom_jvp
def _product(rows: Float[Array, "n 7"], columns: Float[Array, "m 7"], kernel: _Kernel) -> Scalar:
    """The inner product of two varifolds. Its derivative is that in the rows: the columns stay as they are."""
    return _product_and_slope(rows, columns, kernel)[0]


@_product.defjvp
def _product_jvp(primals, tangents):
    value, slope = _product_and_slope(*primals)
    return value, jnp.vdot(slope, tangents[0])


@jax.custom_jvp
def _own_product(patches: Float[Array, "n 7"], kernel: _Kernel) -> Scalar:
    """The inner product of a varifold with itself. Being symmetric, it changes as twice that with a still one."""
    return _product_and_slope(patches, patches, kernel)[0]


@_own_product.defjvp
def _own_product_jvp(primals, tangents):
    patches, kernel = primals
    value, slope = _product_and_slope(patches, patches, kernel)
    return value, 2 * jnp.vdot(slope, tangents[0])


def _product_and_slope(
    rows: Float[Array, "n 7"], columns: Float[Array, "m 7"], kernel: _Kernel
) -> tuple[Scalar, Float[Array, "n 7"]]:
    """The inner product and its derivative in the rows, both in one go over blocks of pairs, by matrix products.

    Plain JAX: the derivative can be differentiated once more, forwards in little memory.
    """
    # Distances come from products of positions, which lose digits far from the origin.
    middle = jax.lax.stop_gradient(jnp.mean(columns[:, :3], axis=0))
    rows, columns = (patches.at[:, :3].add(-middle) for patches in (rows, columns))
    rows_of_blocks, columns_of_blocks = _blocks(rows, _ROWS), _blocks(columns, _COLUMNS)
    centroids, normals, areas = (columns_of_blocks[..., part] for part in _PARTS)
    squares = jnp.sum(centroids**2, axis=-1, keepdims=True)
    right = jnp.concatenate([centroids, jnp.ones_like(areas), squares], axis=-1).swapaxes(1, 2)
    facing = normals.swapaxes(1, 2)
    moments = jnp.concatenate([areas, areas * centroids], axis=-1)

    def row_of_blocks(_, rows):
        centroids_here, normals_here, areas_here = (rows[:, part] for part in _PARTS)
        squares_here = jnp.sum(centroids_here**2, axis=1, keepdims=True)
        left = jnp.concatenate([-2 * centroids_here, squares_here, jnp.ones_like(areas_here)], axis=1)

        def block(sums, columns):
            right, facing, moments, weighted_normals = columns
            # Kept as arrays: otherwise each of the three products has the exponentials computed again.
            gaussian = jax.lax.optimization_barrier(kernel.gaussian(left @ right))
            near, nearer = kernel.near(gaussian)
            alike, more_alike = kernel.alike(normals_here @ facing)
            products = (
                (near * alike) @ moments[:, :1],
                (nearer * alike) @ moments,
                (near * more_alike) @ weighted_normals,
            )
            return jax.tree.map(jnp.add, sums, products), None

        empty = tuple(jnp.zeros((_ROWS, width), rows.dtype) for width in (1, 4, 3))
        sums, _ = jax.lax.scan(block, empty, (right, facing, moments, areas * normals))
        weight, pulls, turns = sums
        pull = 2 * (pulls[:, 1:] - pulls[:, :1] * centroids_here)
        return None, jnp.concatenate([areas_here * pull, areas_here * turns, weight], axis=1)

    slope = jax.lax.scan(row_of_blocks, None, rows_of_blocks)[1].reshape(-1, 7)[: rows.shape[0]]
    return jnp.vdot(rows[:, 6], slope[:, 6]), slope


_PARTS = (slice(0, 3), slice(3, 6), slice(6, 7))  # centroid, normal and area in a row of patches


def _blocks(patches: Float[Array, "n 7"], size: int) -> Float[Array, "b size 7"]:
    """Rows in blocks of one size, the last one filled up with patches of no area."""
    count = -(-patches.shape[0] // size)
    return jnp.pad(patches, ((0, count * size - patches.shape[0]), (0, 0))).reshape(count, size, 7)


@eqx.filter_jit
def _squared_norms(patches: Float[Array, "n 7"], width: Scalar, scales: int, oriented: bool) -> Float[Array, " K"]:
    def squared_norm(width):
        return _product(patches, patches, _Kernel(width, jnp.ones(1, patches.dtype), oriented))

    return jax.lax.map(squared_norm, width * 0.5 ** jnp.arange(scales, dtype=float))


def _checked_width(width: ArrayLike | None, target: Mesh) -> Scalar:
    if width is None:
        return _WIDTH * jnp.linalg.norm(jnp.ptp(target.vertices, axis=0))
    width = jnp.asarray(width, dtype=float)
    if width.shape != ():
        raise ValueError(f"Varifold: width has shape {width.shape}; give one number; its halves come by `scales`.")
    if not isinstance(width, Tracer) and not 0 < float(width) < float("inf"):
        raise ValueError(f"Varifold: width is {width}; it must be finite and positive.")
    return width
