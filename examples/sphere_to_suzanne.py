"""A sphere that becomes Suzanne, Blender's monkey head, whose mesh shares nothing with the sphere's: the direct
problem. The same bilayer is designed three times: nematic, nematic with trained stretches, and growing freely within
bounds."""

import argparse
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float

import shellkit as sk


jax.config.update("jax_enable_x64", True)
sk.keep_compiled()

THICKNESS = 0.1
STRETCH = 1.5  # of the nematic layers, as in the tutorial's reverse problem
FIRST = 2  # subdivisions of the coarsest sphere that is registered
LOW, HIGH = 0.4, 2.5  # of stretches and growth, where they are trained
SOFTNESS = ((1e-1, 1e-2), (1e-2, 1e-3))  # of the shell in the registration: on the first sphere, on finer ones
MATERIALS = ("nematic", "stretch", "growth")
WHAT = {"nematic": "nematic, stretch 1.5", "stretch": "nematic, stretch trained", "growth": "growth, trained"}
ENERGY = sk.NeoHookean(bulk=1.0, shear=1.0) + sk.Bending(alpha=1.0, beta=1.0, form="tan")

Layer = tuple[Float[Array, " F"], Float[Array, " F"], Float[Array, " F"]]


class Registration(eqx.Module):
    """Positions of the sphere's vertices upon the target, and what they cost: nothing of this is relaxed. The distance
    to the target alone would let the triangles degenerate, so that a little of the shell's own energy is added."""

    vertices: Float[Array, "V 3"]
    shell: sk.InverseProblem
    loss: sk.Loss
    softness: Float[Array, ""]

    def objective(self, start=None):
        here = eqx.tree_at(lambda e: e.vertices, self.shell.unrelaxed(), self.vertices)
        distance = self.loss(here, self.shell.actuation)
        deformation = self.shell.total_energy(self.vertices)
        return distance + self.softness * deformation, ({"distance": distance, "deformation": deformation}, None)


def spheres(finest: int, radius: float) -> list[sk.Mesh]:
    """The icosahedron and its refinements on the sphere, by the number of subdivisions."""
    meshes = [sk.meshes.icosphere(0, radius)]
    for _ in range(finest):
        meshes.append(meshes[-1].refine(lambda p: radius * p / jnp.linalg.norm(p, axis=1, keepdims=True)))
    return meshes


def registered(meshes: list[sk.Mesh], target: sk.Mesh, first: int, steps: int) -> dict[int, Array]:
    """Where the vertices of each sphere from the first on would best lie on the target, found by L-BFGS with less and
    less stiffness, from coarse to fine."""
    loss = sk.PointToSurface(target, normals=0.1, aligner=sk.NoAlignment())
    optimiser = optax.lbfgs(memory_size=20)
    positions = {first: meshes[first].vertices}
    for level in range(first, len(meshes)):
        if level > first:
            positions[level] = meshes[level - 1].prolong(positions[level - 1])
        shell = sk.InverseProblem(meshes[level], thickness=0.2 * THICKNESS, energy=ENERGY)
        problem = Registration(positions[level], shell, loss, jnp.asarray(0.0))
        for softness in SOFTNESS[level > first]:
            problem = eqx.tree_at(lambda p: p.softness, problem, jnp.asarray(softness))
            problem = sk.fit(problem, optimiser, steps=steps, where=lambda p: p.vertices, progress=False).problem
        positions[level] = problem.vertices
    return positions


def wanted_layers(mesh: sk.Mesh, vertices: Array) -> list[Layer]:
    """The growth of each layer, top first, that would turn the mesh into these positions without any stress: the forms
    of the target, g ± (2h/3)(b - b0), as stretches along and across a direction in each face."""
    lower = jnp.linalg.cholesky(sk.first_form(mesh.vertices, mesh))
    middle = sk.first_form(vertices, mesh)
    bent = sk.second_form(vertices, mesh, "tan") - sk.second_form(mesh.vertices, mesh, "tan")
    layers = []
    for side in (1, -1):
        metric = middle + side * 2 * THICKNESS / 3 * bent
        squared = jnp.linalg.solve(lower, jnp.swapaxes(jnp.linalg.solve(lower, metric), 1, 2))
        values, axes = jnp.linalg.eigh(squared)
        # Where a layer would have to shrink to less than nothing, it shrinks as far as it may.
        stretch = jnp.sqrt(jnp.clip(values, (1.01 * LOW) ** 2, (0.99 * HIGH) ** 2))
        layers.append((jnp.arctan2(axes[:, 1, 1], axes[:, 0, 1]), stretch[:, 1], stretch[:, 0]))
    return layers


def bilayer(material: str, layers: list[Layer]) -> sk.Bilayer:
    """Two layers of a material, as near as it comes to the growth wanted."""

    def sheet(layer: Layer) -> sk.SheetActuation:
        angle, along, across = layer
        if material == "growth":
            return sk.OrthotropicGrowth(angle, along, across)
        if material == "stretch":
            return sk.Nematic(angle, jnp.clip(jnp.sqrt(along / across), 1.01 * LOW, 0.99 * HIGH))
        return sk.Nematic(angle, jnp.full(angle.shape, STRETCH))

    top, bottom = (sheet(layer) for layer in layers)
    return sk.Bilayer(top, bottom)


def carried(coarse: sk.Mesh, actuation: sk.Bilayer, fine: sk.Mesh) -> sk.Bilayer:
    """A design on another mesh of the sphere: directors as tensors, stretches as numbers."""

    def sheet(layer):
        fields = {"angle": sk.transfer_directors(coarse, layer.angle, fine)}
        for name in ("stretch", "along", "across"):
            if hasattr(layer, name):
                fields[name] = sk.transfer_face_values(coarse, getattr(layer, name), fine)
        return eqx.tree_at(lambda s: [getattr(s, name) for name in fields], layer, list(fields.values()))

    return sk.Bilayer(sheet(actuation.top), sheet(actuation.bottom))


def trained(material: str, problem: sk.InverseProblem, steps: int) -> sk.FitResult:
    """The directors, and the stretches where the material has any to train, by Adam."""
    fields = {"nematic": ["angle"], "stretch": ["angle", "stretch"], "growth": ["angle", "along", "across"]}[material]

    def where(p):
        return [getattr(layer, name) for layer in (p.actuation.top, p.actuation.bottom) for name in fields]

    def stretches(p):
        return [getattr(layer, name) for layer in (p.actuation.top, p.actuation.bottom) for name in fields[1:]]

    bounds = [sk.Bounds(stretches, LOW, HIGH)] if fields[1:] else []
    rate = optax.cosine_decay_schedule(0.03, steps, alpha=0.1)
    return sk.fit(problem, optax.adam(rate), steps=steps, where=where, bounds=bounds, warm_start=sk.WarmStart())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--levels", type=int, nargs="+", default=[2, 3], help="subdivisions of the icosahedron, rising")
    parser.add_argument("--steps", type=int, default=40, help="of Adam on each level")
    parser.add_argument("--materials", nargs="+", choices=MATERIALS, default=list(MATERIALS))
    parser.add_argument("--size", choices=("area", "volume"), default="area", help="of the sphere: the target's")
    parser.add_argument("--quick", action="store_true", help="a coarse sphere and few steps, to see that all runs")
    parser.add_argument("--out", type=Path, default=Path("out/sphere_to_suzanne"), help="folder for the results")
    options = parser.parse_args()
    if options.quick:
        options.levels, options.steps, options.materials = [1], 2, ["growth"]

    target = sk.Mesh.read(Path(__file__).parent / "meshes" / "suzanne.obj")
    by_area = jnp.sqrt(sk.surface_area(target.vertices, target) / (4 * jnp.pi))
    by_volume = jnp.cbrt(3 * sk.enclosed_volume(target.vertices, target) / (4 * jnp.pi))
    radius = float(by_area if options.size == "area" else by_volume)
    loss = sk.PointToSurface(target) + 1e-5 * sk.DirectorSmoothness()

    meshes = spheres(max(options.levels), radius)
    positions = registered(meshes, target, min(FIRST, *options.levels), 30 if options.quick else 80)
    for level in options.levels:
        report("registration, no shell", positions[level], meshes[level], target)

    results = {}
    for material in options.materials:
        for coarse, level in zip([None, *options.levels], options.levels, strict=False):
            mesh = meshes[level]
            actuation = bilayer(material, wanted_layers(mesh, positions[level]))
            if coarse is not None and material != "growth":  # which has its best start from the finest registration
                actuation = carried(meshes[coarse], results[material].problem.actuation, mesh)
            problem = sk.InverseProblem(mesh, THICKNESS, ENERGY, actuation, loss)
            results[material] = trained(material, problem, options.steps)
            found = results[material].history["PointToSurface"]
            print(f"{WHAT[material]}: mean squared distance {found[0]:.2e} at the start, {found.min():.2e} trained")
            report(WHAT[material], results[material].equilibrium.vertices, mesh, target)

    save(results, positions[max(options.levels)], target, options)
    print(f"The designs (vtu) and their pictures are in {options.out}/")


def report(name: str, vertices: Array, mesh: sk.Mesh, target: sk.Mesh) -> sk.Hausdorff:
    """Prints how far a shape is from the target, both ways, in parts of the target's diagonal."""
    laid = sk.register(mesh.with_vertices(vertices), target)
    found = sk.hausdorff(laid(vertices), mesh, target)
    print(
        f"{mesh.n_vertices:>5} vertices  {name:<32} mean {100 * found.relative_mean:6.2f} %   Hausdorff "
        f"{100 * found.relative_distance:6.2f} %   of the diagonal",
        flush=True,
    )
    return found


def save(results: dict, positions: Array, target: sk.Mesh, options: argparse.Namespace) -> None:
    """Shapes and fields as a file for each material, its history, and a picture of all shapes beside the target."""
    options.out.mkdir(parents=True, exist_ok=True)
    shapes = []
    for material, result in results.items():
        actuation, mesh = result.problem.actuation, result.problem.mesh
        shape = sk.register(mesh.with_vertices(result.equilibrium.vertices), target)(result.equilibrium.vertices)
        fields = {
            f"{side}_{name}": getattr(layer, name)
            for side, layer in (("top", actuation.top), ("bottom", actuation.bottom))
            for name in ("angle", "stretch", "along", "across")
            if hasattr(layer, name)
        }
        mesh.write(
            options.out / f"{material}.vtu", vertex_data={"relaxed": shape, "registered": positions}, face_data=fields
        )
        sk.plot_history(result, save=options.out / f"{material}_history.png")
        shapes.append(mesh.with_vertices(shape))
    titles = [*(WHAT[material] for material in results), "target"]
    sk.plot(
        [*shapes, target],
        title=titles,
        color="mean curvature",
        color_range=(-8.0, 8.0),
        camera=(0.4, -1.0, 0.25),
        size=(300, 320) if options.quick else (500, 440),
        save=options.out / "sphere_to_suzanne.png",
    )


if __name__ == "__main__":
    main()
