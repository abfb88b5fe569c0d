"""Makes the pictures of the how-to pages in docs/assets: `python docs/pictures.py`, or with the names of some of them.

Needs OpenGL; without a screen set VTK_DEFAULT_OPENGL_WINDOW=vtkEGLRenderWindow."""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from PIL import Image

import shellkit as sk


jax.config.update("jax_enable_x64", True)

ASSETS = Path(__file__).parent / "assets"
LAYERS = {"top": "#d55e00", "bottom": "#0072b2"}


def disc() -> tuple[sk.Mesh, list[jax.Array]]:
    """A disc whose directors run around the centre, and at 45 degrees to that in the bottom layer."""
    mesh = sk.meshes.disc(10.0, target_edge_length=1.2)
    centres = mesh.vertices[mesh.faces].mean(axis=1)
    around = sk.director_angles(mesh, jnp.cross(jnp.array([0.0, 0.0, 1.0]), centres))
    return mesh, [around, around + jnp.pi / 4]


def shrink(path: Path) -> None:
    """Rewrites a picture with 96 colours, which is a third of its size."""
    Image.open(path).convert("RGB").quantize(96, dither=Image.Dither.NONE).save(path, optimize=True)


def streamlines(path: Path) -> None:
    """The lines of both layers of the disc, side by side."""
    mesh, layers = disc()
    figure = Figure(figsize=(7.2, 3.7), layout="constrained")
    outline = np.asarray(mesh.vertices)[mesh.boundary_loops()[0]]
    for axes, (name, color), angles in zip(figure.subplots(1, 2), LAYERS.items(), layers, strict=True):
        axes.fill(outline[:, 0], outline[:, 1], facecolor="#f4f2ee", edgecolor="#222222", linewidth=1)
        for line in sk.streamlines(mesh, angles, spacing=0.8):
            axes.plot(line[:, 0], line[:, 1], color=color, linewidth=1.1)
        axes.set_title(f"{name} layer", color=color)
        axes.set_aspect("equal")
        axes.set_axis_off()
    figure.savefig(path, dpi=90)
    shrink(path)


def director_image(path: Path) -> None:
    """The picture that a projector would show for the top layer."""
    mesh, layers = disc()
    with tempfile.TemporaryDirectory() as folder:
        (written,) = sk.export_directors(Path(folder) / "a.png", mesh, directors=layers[:1], pixel=0.05)
        grey = Image.open(written)
        picture = Image.new("LA", grey.size, (255, 255))
        picture.paste(grey, mask=grey.getchannel("A"))
        picture.convert("L").save(path, optimize=True)


def heated(path: Path) -> None:
    """A clamped strip of two metals that was heated, coloured by how far it moved."""
    heat = [sk.IsotropicGrowth(1 + 80 * expansion) for expansion in (12e-6, 19e-6)]
    problem = sk.InverseProblem(
        mesh=sk.meshes.rectangle(60.0, 20.0, cells=(24, 8)),
        thickness=0.3,
        energy=sk.StVenantKirchhoff.from_young(2e5, 0.3) + sk.Bending.from_young(2e5, 0.3, directors="free"),
        actuation=sk.Bilayer(*heat),
        supports=sk.Clamped(lambda x: x[:, 0] < jnp.min(x[:, 0]) + 0.01),
    )
    sk.plot(problem(), color="displacement", unit="mm", camera=(-0.4, -1.0, 0.4), save=path)
    shrink(path)


def thickened(path: Path) -> None:
    """A cap as a body, cut open to show its wall."""
    import pyvista as pv

    cap = sk.meshes.spherical_cap(20.0, np.deg2rad(50), target_edge_length=1.5)
    body = sk.thicken(cap, 1.2)
    solid = pv.PolyData.from_regular_faces(np.asarray(body.vertices), np.asarray(body.faces))
    cut = solid.clip_closed_surface(normal=(0.3, 1.0, 0.0), origin=(0.0, -3.0, 0.0))
    plotter = pv.Plotter(off_screen=True, window_size=(840, 520), lighting="light kit")
    plotter.background_color = "white"
    plotter.enable_anti_aliasing("ssaa")
    plotter.add_mesh(cut, color="#e9e6df", smooth_shading=True, split_sharp_edges=True, feature_angle=20)
    plotter.add_mesh(cut.extract_feature_edges(35), color="#222222", line_width=2)
    plotter.camera_position = [(18.0, -70.0, 40.0), (0.0, 2.0, 16.0), (0.0, 0.0, 1.0)]
    plotter.camera.zoom(1.5)
    plotter.screenshot(path)
    plotter.close()
    shrink(path)


def heated_strip() -> tuple[sk.InverseProblem, sk.Path]:
    """A strip that rolls up as it is heated, as in docs/how-to/pictures.md."""
    mesh = sk.meshes.rectangle(40.0, 12.0, cells=(20, 6), diagonals="alternating")
    along = sk.director_angles(mesh, jnp.array([1.0, 0.0, 0.0]))
    problem = sk.InverseProblem(
        mesh=mesh,
        thickness=1.0,
        actuation=sk.Bilayer(sk.Nematic(along, stretch=0.96), sk.Nematic(along + jnp.pi / 2, stretch=0.96)),
        energy=sk.StVenantKirchhoff.from_young(1.0, 0.4) + sk.Bending.from_young(1.0, 0.4, form="tan"),
    )
    return problem, sk.follow(problem, sk.Ramp(16))


def stress(path: Path) -> None:
    """The rolled strip under its stress."""
    problem, ramp = heated_strip()
    sk.plot(ramp.equilibria[-1], problem=problem, color="stress", stress_unit="MPa", directors=False, save=path).close()
    shrink(path)


def ramp(path: Path) -> None:
    """The strip as it rolls up."""
    _, ramp = heated_strip()
    sk.animate(ramp, path, color="displacement", unit="mm", size=(240, 256), fps=8)


def surface_losses(path: Path) -> None:
    """Two strips from the side, and where three losses pull the vertices of the upper one."""

    def strip(cells, height):
        flat = sk.meshes.rectangle(4.0, 0.6, cells=(cells, 2))
        x, y, _ = flat.vertices.T
        return flat.with_vertices(jnp.stack([x, y, height(x)], axis=1))

    def line(mesh, field):
        places = np.asarray(mesh.vertices)
        row = np.flatnonzero(np.abs(places[:, 1] - 0.3) < 1e-9)
        return np.asarray(field)[row[np.argsort(places[row, 0])]][:, [0, 2]].T

    here = strip(16, lambda x: 0.9 + 0.0 * x)
    there = strip(11, lambda x: 0.55 * jnp.exp(-4 * (x - 1.2) ** 2) - 0.35 * jnp.exp(-6 * (x - 2.8) ** 2))
    flat = sk.InverseProblem(here, 0.1, energy=sk.StVenantKirchhoff(alpha=1.0, beta=1.0)).unrelaxed()
    still = sk.NoAlignment()
    losses = {
        "PointToSurface: to the nearest points, both ways": sk.PointToSurface(there, aligner=still),
        "Chamfer: to the nearest vertices, both ways": sk.Chamfer(there.vertices, aligner=still),
        "Varifold: all patches within its widths": sk.Varifold(there, width=1.0, scales=2, aligner=still),
    }
    figure = Figure(figsize=(7, 6.4), layout="constrained")
    for panel, (title, loss) in zip(figure.subplots(3, 1), losses.items(), strict=True):
        slope = jax.grad(lambda v, loss=loss: loss(eqx.tree_at(lambda e: e.vertices, flat, v), sk.Passive()))
        pull = line(here, -slope(here.vertices))
        for mesh, colour in ((there, "#888888"), (here, LAYERS["bottom"])):
            panel.plot(*line(mesh, mesh.vertices), color=colour, marker="o", markersize=3)
        pull *= 0.6 / np.linalg.norm(pull, axis=0).max()
        panel.quiver(
            *line(here, here.vertices),
            *pull,
            color=LAYERS["top"],
            angles="xy",
            scale_units="xy",
            scale=1,
            width=0.003,
        )
        panel.set_title(title, loc="left", fontsize=10)
        panel.set_aspect("equal")
        panel.set_axis_off()
    figure.savefig(path, dpi=110)
    shrink(path)


PICTURES = {
    "streamlines.png": streamlines,
    "director-image.png": director_image,
    "heated.png": heated,
    "thickened.png": thickened,
    "stress.png": stress,
    "ramp.gif": ramp,
    "surface_losses.png": surface_losses,
}


def draw(pictures: dict[str, Callable[[Path], None]]) -> None:
    """Makes those named on the command line, or all."""
    for name in sys.argv[1:] or pictures:
        pictures[name](ASSETS / name)
        print(f"{name}: {(ASSETS / name).stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    draw(PICTURES)
