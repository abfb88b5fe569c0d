"""The table of other programs' moduli on the page on accuracy: each row is the same sheet."""

import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk
from validation.cards import moduli


YOUNG, POISSON, THICKNESS = moduli.YOUNG, moduli.POISSON, moduli.THICKNESS
ALPHA, BETA = YOUNG * POISSON / 2 / (1 - POISSON**2), YOUNG / 4 / (1 + POISSON)


@pytest.fixture(scope="module")
def sheet():
    """A patch under a random affine map, its two energies, and M and K of any face."""
    stretching, bending = (
        moduli.patch(energy)
        for energy in (sk.StVenantKirchhoff.from_young(YOUNG, POISSON), sk.Bending.from_young(YOUNG, POISSON))
    )
    mesh = stretching.mesh
    map_ = np.eye(2) + 0.1 * np.random.default_rng(0).normal(size=(2, 2))
    moved = mesh.vertices.at[:, :2].set(mesh.vertices[:, :2] @ map_.T)
    curvature = np.array([[0.4, 0.1], [0.1, -0.3]])
    edges = (mesh.vertices[mesh.faces[:, 1:]] - mesh.vertices[mesh.faces[:, :1]])[:, :, :2]
    bent = sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        actuation=sk.Prescribed(curvature=jnp.einsum("fia,ab,fjb->fij", edges, curvature, edges)),
        energy=bending.energy,
    )
    energies = float(stretching.total_energy(moved)), float(bent.total_energy(mesh.vertices))
    return mesh, moved, energies, map_.T @ map_ - np.eye(2), -curvature


def quadratic(first, second, form):
    return first * np.trace(form) ** 2 + 2 * second * np.trace(form @ form)


def test_textbooks(sheet):
    """Plane-stress Lamé pair, Green's strain, on a unit square."""
    _, _, (stretching, bending), strain, bend = sheet
    first, second = YOUNG * POISSON / (1 - POISSON**2), YOUNG / 2 / (1 + POISSON)
    density = lambda e: 0.5 * first * np.trace(e) ** 2 + second * np.trace(e @ e)
    assert np.isclose(stretching, THICKNESS * density(strain / 2), rtol=1e-12)
    assert np.isclose(bending, THICKNESS**3 / 12 * density(bend), rtol=1e-12)


def test_libshell(sheet):
    """Its h/8 and h³/24 with the whole Lamé pair, twice our alpha and beta."""
    _, _, (stretching, bending), strain, bend = sheet
    assert np.isclose(stretching, THICKNESS / 8 * quadratic(2 * ALPHA, 2 * BETA, strain), rtol=1e-12)
    assert np.isclose(bending, THICKNESS**3 / 24 * quadratic(2 * ALPHA, 2 * BETA, bend), rtol=1e-12)


def test_triangulax(sheet):
    """The library itself, where it is installed: bare sums, to be multiplied by h/4 and h³/12."""
    elastic = pytest.importorskip("triangulax.elastic")
    half_edges = pytest.importorskip("triangulax.mesh")
    mesh, moved, (stretching, _), _, _ = sheet
    theirs = half_edges.HeMesh.from_triangles(mesh.n_vertices, mesh.faces)
    metric = elastic.get_metric(mesh.vertices, theirs)
    found = elastic.get_st_venant_kirchhoff_energy(moved, (theirs, metric, ALPHA, BETA))
    assert np.isclose(THICKNESS / 4 * float(found), stretching, rtol=1e-12)
