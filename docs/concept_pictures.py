"""Makes the pictures of the pages on concepts in docs/assets: `python docs/concept_pictures.py`, or with the names of
some of them. They are drawn from computed shapes, energies and gradients, except for the sketch of a face."""

import functools
import tempfile
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from matplotlib.figure import Figure
from pictures import LAYERS, draw, shrink
from PIL import Image, ImageSequence

import shellkit as sk


jax.config.update("jax_enable_x64", True)

UP = jnp.array([0.0, 0.0, 1.0])
GREY, DARK = "#8a8a8a", "#222222"
GREEN = "#009e73"
ENERGY = sk.StVenantKirchhoff.from_young(1.0, 0.3) + sk.Bending.from_young(1.0, 0.3, form="tan", directors="free")


def surface(path: Path) -> None:
    """A face with its edges, its frame and a director; and a hinge from the side."""
    figure = Figure(figsize=(7.6, 3.0), layout="constrained")
    face, hinge = figure.subplots(1, 2, width_ratios=(1.1, 1))
    a, b, c = np.array([0.0, 0.0]), np.array([2.2, 0.0]), np.array([0.8, 1.5])
    face.fill(*np.array([a, b, c]).T, facecolor="#f1eee8", edgecolor=DARK, linewidth=1)
    _arrow(face, a, b, DARK, "$u$", (1.25, -0.2))
    _arrow(face, a, c, DARK, "$v$", (0.2, 0.85))
    for corner, name, where in ((a, "$a$", (-0.14, -0.1)), (b, "$b$", (2.3, -0.08)), (c, "$c$", (0.8, 1.62))):
        face.plot(*corner, "o", color=DARK, markersize=4)
        face.text(*where, name, ha="center", va="center", fontsize=12)
    centre, angle = (a + b + c) / 3, np.deg2rad(38)
    director = np.array([np.cos(angle), np.sin(angle)])
    face.plot(*np.stack([centre - 0.36 * director, centre + 0.36 * director]).T, color=LAYERS["top"], linewidth=4)
    face.plot(*np.stack([centre, centre + np.array([0.55, 0.0])]).T, color=GREY, linewidth=1, linestyle="--")
    turn = np.linspace(0, angle, 20)
    face.plot(centre[0] + 0.28 * np.cos(turn), centre[1] + 0.28 * np.sin(turn), color=GREY, linewidth=1)
    face.text(centre[0] + 0.42, centre[1] + 0.13, r"$\theta$", fontsize=12)
    face.text(*(centre - [0.1, 0.34]), "director", color=LAYERS["top"], fontsize=10, va="center", ha="left")

    slope, length = np.deg2rad(28), 1.25
    left, right = (length * np.array([side * np.cos(slope), -np.sin(slope)]) for side in (-1, 1))
    for end, normal, name in ((left, (-1, 1), "$n$"), (right, (1, 1), "$n'$")):
        hinge.plot(*np.stack([np.zeros(2), end]).T, color=DARK, linewidth=2.5)
        normal = np.array([normal[0] * np.sin(slope), np.cos(slope)])
        middle = 0.55 * end
        _arrow(hinge, middle, middle + 0.62 * normal, LAYERS["bottom"], name, middle + 0.76 * normal)
        _arrow(hinge, np.zeros(2), 0.75 * normal, LAYERS["bottom"], "", (0, 0), alpha=0.35)
    _arrow(hinge, np.zeros(2), (0, 1.0), GREEN, "$n_e$", (0.0, 1.13))
    turn = np.linspace(np.pi / 2 - slope, np.pi / 2 + slope, 30)
    hinge.plot(0.55 * np.cos(turn), 0.55 * np.sin(turn), color=GREY, linewidth=1)
    hinge.text(0.17, 0.66, r"$\theta_e$", fontsize=12)
    hinge.plot(0, 0, "o", color=DARK, markersize=5)
    hinge.text(0.12, -0.02, "edge $e$", ha="left", va="center", fontsize=10)
    ends = {"arrowstyle": "<->", "color": GREY, "shrinkA": 0, "shrinkB": 0}
    hinge.annotate("", left - [0.05, 0.1], np.array([-0.05, -0.1]), arrowprops=ends)
    hinge.text(*(0.62 * left - [-0.12, 0.3]), "$h_e$", fontsize=12, color=GREY, ha="center")
    face.set(title="a face, its edges and a director", xlim=(-0.3, 2.5), ylim=(-0.35, 1.75))
    hinge.set(title="a hinge, seen along its edge", xlim=(-1.3, 1.3), ylim=(-0.85, 1.25))
    for panel in (face, hinge):
        panel.set_aspect("equal")
        panel.set_axis_off()
    figure.savefig(path, dpi=120)
    shrink(path)


def _arrow(axes, start, end, color, text, where, alpha=1.0) -> None:
    look = {"arrowstyle": "-|>", "color": color, "linewidth": 1.8, "shrinkA": 0, "shrinkB": 0, "alpha": alpha}
    axes.annotate("", end, start, arrowprops=look)
    axes.text(*where, text, color=color, ha="center", va="center", fontsize=12)


@functools.cache
def cone() -> tuple[sk.InverseProblem, sk.Equilibrium]:
    """A disc with directors around its centre, heated: it shortens along them and rises."""
    mesh = sk.meshes.disc(1.0, target_edge_length=0.16)
    around = sk.director_angles(mesh, jnp.cross(UP, mesh.vertices[mesh.faces].mean(axis=1)))
    problem = sk.InverseProblem(mesh=mesh, thickness=0.02, actuation=sk.Nematic(around, stretch=0.88), energy=ENERGY)
    return problem, _upright(problem())


def _upright(equilibrium: sk.Equilibrium) -> sk.Equilibrium:
    """The centre above the rim."""
    z = equilibrium.vertices[:, 2]
    up = jnp.sign(z[0] - z.mean())
    return eqx.tree_at(lambda e: e.vertices, equilibrium, equilibrium.vertices * jnp.array([1.0, 1.0, up]))


def actuation(path: Path) -> None:
    """What growth, directors and two layers do to flat sheets."""
    mesh = cone()[0].mesh
    radius = jnp.linalg.norm(mesh.vertices[mesh.faces].mean(axis=1), axis=1)
    ruffled = sk.InverseProblem(
        mesh=mesh, thickness=0.02, actuation=sk.IsotropicGrowth(1.0 + 0.25 * radius**2), energy=ENERGY
    )
    strip = sk.meshes.rectangle(2.4, 0.8, cells=(18, 6), diagonals="alternating")
    along = sk.director_angles(strip, jnp.array([1.0, 0.0, 0.0]))
    rolled = sk.InverseProblem(
        mesh=strip,
        thickness=0.06,
        actuation=sk.Bilayer(sk.Nematic(along, stretch=0.96), sk.Nematic(along + jnp.pi / 2, stretch=0.96)),
        energy=ENERGY,
    )
    problems = (ruffled, cone()[0], rolled)
    shapes = (sk.relax(ruffled, sk.Ramp(4)), cone()[1], sk.relax(rolled, sk.Ramp(4)))
    titles = ("growth, more at the rim", "directors around the centre", "two layers, crossed")
    with tempfile.TemporaryDirectory() as folder:
        panels = []
        for number, (problem, shape, title) in enumerate(zip(problems, shapes, titles, strict=True)):
            file = Path(folder) / f"{number}.png"
            sk.plot(
                shape,
                problem=problem,
                color=False,
                title=title,
                camera=(0.5, -1.0, 0.7),
                size=(420, 380),
                save=file,
            ).close()
            panels.append(Image.open(file).convert("RGB"))
        _beside(panels, path)


def _beside(panels: list[Image.Image], path: Path) -> None:
    whole = Image.new("RGB", (sum(panel.width for panel in panels), max(panel.height for panel in panels)), "white")
    left = 0
    for panel in panels:
        whole.paste(panel, (left, 0))
        left += panel.width
    whole.save(path)
    shrink(path)


def energy(path: Path) -> None:
    """What stretching costs by each material, and what a hinge costs by each form."""
    square = sk.meshes.rectangle(1.0, 1.0, cells=(1, 1))
    hinge = sk.Mesh(np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0.0]]), np.array([[0, 1, 2], [1, 0, 3]]))
    stretches, angles = jnp.linspace(0.35, 1.9, 80), jnp.linspace(0, np.deg2rad(176), 90)
    turn = lambda t: hinge.vertices.at[3].set(jnp.array([0.5, -jnp.cos(t), jnp.sin(t)]))
    folded = jax.vmap(turn)(angles)
    pulled = jax.vmap(lambda s: square.vertices * jnp.array([s, 1.0, 1.0]))(stretches)
    materials = {
        "StVenantKirchhoff": sk.StVenantKirchhoff.from_young(1.0, 0.3),
        "NeoHookean": sk.NeoHookean.from_young(1.0, 0.3),
        "IncompressibleNeoHookean": sk.IncompressibleNeoHookean(shear=1 / 3),
        "TensionField": sk.TensionField.from_young(1.0, 0.3),
    }
    forms = {f'form="{form}"': sk.Bending.from_young(1.0, 0.3, form=form) for form in ("sin", "theta", "tan")}
    colors = (LAYERS["bottom"], LAYERS["top"], GREEN, "#cc79a7")
    figure = Figure(figsize=(7.6, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for (name, term), color in zip(materials.items(), colors, strict=True):
        values = jax.vmap(sk.InverseProblem(mesh=square, thickness=1.0, energy=term).total_energy)(pulled)
        dashes = (0, (4, 3)) if name == "TensionField" else "-"  # over the curve that it shares in tension
        left.plot(stretches, values, label=name, color=color, linewidth=1.8, linestyle=dashes)
    for (name, term), color in zip(forms.items(), colors, strict=False):
        values = jax.vmap(sk.InverseProblem(mesh=hinge, thickness=1.0, energy=term).total_energy)(folded)
        right.plot(np.degrees(angles), values, label=name, color=color, linewidth=1.8)
    left.set(xlabel="stretch along, none across", ylabel="energy / (E · volume)", ylim=(0, 0.6))
    right.set(xlabel="angle of a hinge (°)", ylabel="energy, thickness 1", ylim=(0, 3), xticks=(0, 60, 120, 180))
    left.legend(frameon=False, fontsize="small", loc="upper center")
    right.legend(frameon=False, fontsize="small")
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=120)
    shrink(path)


def equilibrium(path: Path) -> None:
    """The energy of the heated disc between its two cones: two minima, and the flat start between them, a saddle."""
    problem, risen = cone()
    flat = problem.mesh.vertices
    parts = jnp.linspace(-1.25, 1.25, 101)
    # Heights by s, places in the plane by s²: the disc shortens as it rises, whichever way.
    inward = (risen.vertices - flat) * jnp.array([1.0, 1.0, 0.0])
    upward = (risen.vertices - flat) * UP
    shape = lambda s: flat + s**2 * inward + s * upward
    energies = np.asarray(jax.lax.map(lambda s: problem.total_energy(shape(s)), parts))
    figure = Figure(figsize=(7.6, 3.4))
    axes = figure.add_axes((0.11, 0.15, 0.87, 0.82))
    axes.plot(parts, energies / energies[50], color=DARK, linewidth=2)
    axes.set(xlabel="height of the centre, as a part of the cone's", ylabel="energy / energy when flat")
    axes.set(xlim=(-1.45, 1.45), ylim=(-0.3, 1.9))
    axes.spines[["top", "right"]].set_visible(False)
    with tempfile.TemporaryDirectory() as folder:
        for s, name in ((-1.0, "a minimum"), (0.0, "a saddle: the start"), (1.0, "the other minimum")):
            here, file = float(energies[np.argmin(np.abs(parts - s))] / energies[50]), Path(folder) / "shape.png"
            drawn = problem.mesh.with_vertices(shape(s))
            sk.plot(drawn, camera=(0.4, -1.0, 0.35), size=(360, 300), save=file).close()
            axes.plot(s, here, "o", color=LAYERS["top"], zorder=3)
            picture = np.asarray(Image.open(file).convert("RGBA"))[45:235].copy()
            picture[..., 3] = 255 * (picture[..., :3].min(axis=2) < 253)  # the curve shows through what is white
            inset = axes.inset_axes((s - 0.37, here + 0.2, 0.74, 0.6), transform=axes.transData)
            inset.imshow(picture)
            inset.set_axis_off()
            axes.text(s, here + (0.1 if s == 0 else -0.2), name, ha="center", va="bottom", fontsize=10)
    figure.savefig(path, dpi=120)
    shrink(path)


def _as_webp(film: Path, path: Path) -> None:
    image = Image.open(film)
    times, frames = [], []
    for frame in ImageSequence.Iterator(image):
        frames.append(frame.convert("RGB"))
        times.append(frame.info["duration"])
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=times, loop=0, quality=72, method=6)


@functools.cache
def ellipsoid() -> sk.InverseProblem:
    """The design of the first page."""
    mesh = sk.meshes.icosphere(subdivisions=1)
    layer = sk.Nematic(angle=jnp.zeros(mesh.n_faces), stretch=1.1)
    return sk.InverseProblem(
        mesh=mesh,
        thickness=0.1,
        actuation=sk.Bilayer(top=layer, bottom=layer),
        energy=sk.StVenantKirchhoff(alpha=1.0, beta=1.0) + sk.Bending(alpha=1.0, beta=1.0),
        loss=sk.VertexDistance(mesh.vertices * jnp.array([0.95, 0.95, 1.2]), aligner=sk.Kabsch())
        + 1e-3 * sk.DirectorSmoothness(),
    )


def training(path: Path) -> None:
    """The directors and the shape of the first page's design while it is trained, and its loss."""
    film = sk.Snapshots(every=5)
    angles = lambda p: (p.actuation.top.angle, p.actuation.bottom.angle)
    result = sk.fit(ellipsoid(), optax.adam(0.1), steps=80, where=angles, callbacks=[film], progress=False)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "training.gif"
        sk.animate(film, file, color=False, size=(200, 210), fps=6, pause=2)
        _as_webp(file, path)
    sk.plot_history(result, size=(5.6, 3.0), save=path.with_name("history.png"))
    shrink(path.with_name("history.png"))


def gradients(path: Path) -> None:
    """Where the loss pulls each director of the first page's design, and what an expansion by the gradient leaves."""
    problem = ellipsoid()
    mesh = problem.mesh
    angles = jax.random.uniform(jax.random.key(0), (2, mesh.n_faces), maxval=jnp.pi)
    problem = eqx.tree_at(lambda p: (p.actuation.top.angle, p.actuation.bottom.angle), problem, tuple(angles))
    slope = eqx.filter_grad(lambda p: p.evaluate()[0])(problem)
    report = sk.taylor_test(problem, where=lambda p: p.actuation.top.angle)
    figure = Figure(figsize=(7.6, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "slope.png"
        values = 1e3 * slope.actuation.top.angle
        sk.plot(problem, color=values, name="1000 × slope of the loss, per radian", size=(600, 600), save=file).close()
        left.imshow(Image.open(file))
    left.set_axis_off()
    steps, remainders = np.asarray(report.steps), np.asarray(report.remainders)
    right.loglog(steps, remainders, "o-", color=LAYERS["bottom"], label="what the expansion leaves")
    right.loglog(steps, remainders[0] * (steps / steps[0]) ** 2, ":", color=DARK, label="slope 2")
    right.set(xlabel="step along a random direction", ylabel="remainder")
    right.xaxis.set_minor_formatter("")
    right.legend(frameon=False, fontsize="small")
    right.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=120)
    shrink(path)


PICTURES = {
    "surface.png": surface,
    "actuation.png": actuation,
    "energy.png": energy,
    "equilibrium.png": equilibrium,
    "training.webp": training,
    "gradients.png": gradients,
}


if __name__ == "__main__":
    draw(PICTURES)
