"""The peer: triangulax and optimistix's NonlinearCG, put together as in triangulax's tutorial on inverse problems. It
runs in an interpreter of its own, and knows nothing of shellkit."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from triangulax import algorithms, elastic, geometry
from triangulax.mesh import HeMesh
from triangulax.triangular import TriMesh

from .measure import profile
from .tutorial import (
    FOLDS,
    ROLL_ALPHA,
    ROLL_BETA,
    ROLL_THICKNESS,
    SMOOTHNESS_OF,
    THICKNESS,
    ellipsoid,
    fields,
    gradient_probes,
    roll_curvature,
    rolled,
    shape_probes,
)


_ADJOINTS = {
    "dense": optx.ImplicitAdjoint(),
    "cg": optx.ImplicitAdjoint(lx.CG(rtol=1e-6, atol=1e-12, max_steps=10_000)),
}
TOLERANCE = 1e-9  # the tutorial's


class Scene(eqx.Module):
    """A mesh with its rest shape, and which of the tutorial's two problems is posed on it."""

    mesh: HeMesh
    vertices: jax.Array
    metric: jax.Array
    curvature: jax.Array
    stretch: jax.Array
    loss: str = eqx.field(static=True)
    max_steps: int = eqx.field(static=True)
    tolerance: float = eqx.field(static=True)
    moduli: tuple[float, float, float] = eqx.field(static=True)  # thickness, alpha and beta

    @classmethod
    def read(
        cls, path: str, loss: str, stretch: float, max_steps: int, tolerance: float, moduli=(THICKNESS, 1.0, 1.0)
    ) -> "Scene":
        file = TriMesh.read_obj(path, dim=3)
        mesh = HeMesh.from_triangles(len(file.vertices), file.faces)
        if not jnp.array_equal(mesh.faces, file.faces):
            raise ValueError("triangulax turned the corners of faces, so that angles would not compare")
        vertices = jnp.asarray(file.vertices)
        metric = elastic.get_metric(vertices, mesh)
        curvature = elastic.get_second_fundamental_form(vertices, mesh)
        return cls(mesh, vertices, metric, curvature, jnp.asarray(stretch), loss, max_steps, tolerance, moduli)

    def layer(self, angle: jax.Array) -> jax.Array:
        """The metric that a nematic layer would like to have."""
        square, inverse = self.stretch**2, self.stretch**-2
        mean, half = (square + inverse) / 2, (square - inverse) / 2
        c, s = half * jnp.cos(2 * angle), half * jnp.sin(2 * angle)
        stretched = jnp.stack([jnp.stack([mean + c, s], -1), jnp.stack([s, mean - c], -1)], -2)
        root = jnp.linalg.cholesky(self.metric)
        return root @ stretched @ jnp.swapaxes(root, -1, -2)

    def rest(self, angles: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        """Metric and curvature at rest of the bilayer."""
        top, bottom = map(self.layer, angles)
        return (top + bottom) / 2, self.curvature + 0.75 / THICKNESS * (top - bottom)

    def energy(self, vertices: jax.Array, rest: tuple[jax.Array, jax.Array]) -> jax.Array:
        (thickness, alpha, beta), (metric, curvature) = self.moduli, rest
        neo_hookean = self.loss == "sphericity"
        stretching = elastic.get_neo_hookean_energy if neo_hookean else elastic.get_st_venant_kirchhoff_energy
        return thickness / 4 * stretching(vertices, (self.mesh, metric, alpha, beta)) + thickness**3 / 12 * (
            elastic.get_svk_bending_energy(vertices, (self.mesh, metric, curvature, alpha, beta))
        )

    def relax(self, rest: tuple[jax.Array, jax.Array], adjoint: str) -> optx.Solution:
        tags = frozenset({lx.positive_semidefinite_tag}) if adjoint == "cg" else frozenset()
        method = optx.NonlinearCG(rtol=self.tolerance, atol=self.tolerance)
        options = {"max_steps": self.max_steps, "adjoint": _ADJOINTS[adjoint], "tags": tags, "throw": False}
        return optx.minimise(self.energy, method, self.vertices, rest, **options)

    def smoothness(self, angle: jax.Array) -> jax.Array:
        e1, e2 = geometry.get_face_tangent_basis(self.vertices, self.mesh)
        director = jnp.cos(angle)[:, None] * e1 + jnp.sin(angle)[:, None] * e2
        line = director[:, :, None] * director[:, None, :]
        jump = line[self.mesh.heface] - line[self.mesh.heface[self.mesh.twin]]
        return jnp.mean(jnp.sum(jump**2, axis=(1, 2)))

    def sphericity(self, vertices: jax.Array) -> jax.Array:
        areas = geometry.get_barycentric_cell_areas(vertices, self.mesh)
        weights = areas / jnp.sum(areas)
        radii = jnp.linalg.norm(vertices - weights @ vertices, axis=1)
        return weights @ (radii / (weights @ radii) - 1) ** 2

    def misfit(self, vertices: jax.Array) -> jax.Array:
        """The part of the loss that looks at the relaxed shape."""
        if self.loss == "ellipsoid":
            target = ellipsoid(self.vertices)
            return jnp.mean((algorithms.kabsch_align(vertices, target)[0] - target) ** 2)
        return self.sphericity(vertices) + FOLDS * elastic.get_dihedral_bending_energy(vertices, (self.mesh, 0.0, 1.0))


def design_step(adjoint: str, scene: Scene, angles: tuple[jax.Array, jax.Array]):
    def loss(angles):
        solution = scene.relax(scene.rest(angles), adjoint)
        smoothness = sum(map(scene.smoothness, angles))
        value = scene.misfit(solution.value) + SMOOTHNESS_OF[scene.loss] * smoothness
        return value, _told(solution)

    return jax.value_and_grad(loss, has_aux=True)(angles)


def measure(
    mesh: str,
    loss: str,
    stretch: float,
    max_steps: int,
    field: str,
    adjoint: str,
    forward: bool,
    runs: int,
    tolerance: float = TOLERANCE,
) -> dict:
    """The design step on the mesh in a file; with `forward`, the relaxation alone as well."""
    scene = Scene.read(mesh, loss, stretch, max_steps, tolerance)
    angles = fields(field, scene.mesh.n_faces)
    ((value, solution), gradient), record = profile(partial(design_step, adjoint), scene, angles, runs=runs)
    record |= _ending(scene, scene.rest(angles), *solution)
    record |= {"value": float(value), "gradient_probes": gradient_probes(gradient)}
    if forward:
        alone = lambda scene, angles: scene.relax(scene.rest(angles), "dense").value
        record["forward"] = profile(alone, scene, angles, runs=runs)[1]
    return record


def roll(mesh: str, max_steps: int, runs: int) -> dict:
    """The relaxation from the flat square, in triangulax's own basis of each face."""
    scene = Scene.read(mesh, "roll", 1.0, max_steps, TOLERANCE, (ROLL_THICKNESS, ROLL_ALPHA, ROLL_BETA))
    rest = scene.metric, roll_curvature(scene.vertices, jnp.asarray(scene.mesh.faces))
    solution, record = profile(lambda scene, rest: _told(scene.relax(rest, "dense")), scene, rest, runs=runs)
    return record | _ending(scene, rest, *solution) | {"exact_probes": shape_probes(rolled(scene.vertices))}


def _told(solution: optx.Solution) -> tuple[jax.Array, jax.Array, jax.Array]:
    return solution.value, solution.stats["num_steps"], solution.result == optx.RESULTS.successful


def _ending(scene: Scene, rest: tuple[jax.Array, jax.Array], vertices: jax.Array, steps, converged) -> dict:
    return {
        "steps": int(steps),
        "converged": bool(converged),
        "energy": float(scene.energy(vertices, rest)),
        "force_norm": float(jnp.linalg.norm(jax.grad(scene.energy)(vertices, rest))),
        "shape_probes": shape_probes(vertices),
    }
