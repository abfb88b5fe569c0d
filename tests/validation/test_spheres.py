"""Cards 2 and 6 of the validation: the swollen sphere and the spectrum of the sphere."""

import numpy as np
import pytest

import shellkit as sk
from validation.cards import spectrum, sphere
from validation.figures import Figure, order
from validation.meshes import KINDS
from validation.meshes import sphere as mesh_of


@pytest.mark.parametrize("kind", KINDS)
def test_sphere_meshes_are_spheres(kind):
    mesh = mesh_of(kind, 6)
    assert mesh.is_closed and mesh.n_vertices == 6 * 6 * 6 + 2
    assert np.allclose(np.linalg.norm(mesh.vertices, axis=1), 1.0)
    assert abs(float(sk.enclosed_volume(mesh.vertices, mesh)) / (4 * np.pi / 3) - 1) < 0.05


@pytest.mark.slow
def test_swollen_sphere():
    found, _ = sphere.swell("J", 6, "free")
    assert found.converged
    assert abs(float(found.radius) - sphere.RADIUS) < 5e-5
    assert abs(float(found.by_stretch) - sphere.BY_STRETCH) < 5e-5
    assert abs(float(found.by_curvature) / sphere.BY_CURVATURE - 1) < 2e-2


@pytest.mark.slow
@pytest.mark.parametrize("directors", ["free", "average"])
def test_sphere_whose_forms_agree_is_exact(directors):
    assert sphere.compatible("J", 4, directors) < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_swollen_sphere_converges(kind):
    figures = [
        Figure("radius", kind, cells, sphere.RADIUS, float(sphere.swell(kind, cells, "free")[0].radius), 0.0)
        for cells in (4, 8, 16)
    ]
    assert order(figures) > 1.8 and abs(figures[-1].error) < 5e-6


def worst(mesh, thickness, **options):
    values = np.asarray(spectrum.modes(mesh, thickness, "free", **options)[0].eigenvalues)
    assert np.abs(values[:6]).max() < 1e-12
    exact = np.repeat((0.0, *spectrum.EXACT[thickness]), (6, 5, 7))
    return np.abs(values[6:18] / exact[6:] - 1).max()


def test_spectrum_of_the_icosphere():
    assert worst(sk.meshes.icosphere(3), 0.1) < 4e-3


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_spectrum_converges(kind):
    figures = [Figure("mode", kind, cells, 0.0, worst(mesh_of(kind, cells), 0.1), 0.0) for cells in (12, 16, 24)]
    assert order(figures) > 1.8 and figures[-1].error < 1e-2
