"""Bodies whose areas, angles and curvatures are known exactly."""

import numpy as np
import pytest

import shellkit as sk


@pytest.fixture(scope="module")
def cube():
    """The unit cube, each side halved by a diagonal, outward normals."""
    corners = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
    sides = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [face for a, b, c, d in sides for face in ((a, b, c), (a, c, d))]
    return sk.Mesh(corners, faces)


@pytest.fixture(scope="module")
def roof():
    """Two faces that share the edge from (0, 0, 0) to (1, 0, 0), as a function of the angle between their normals."""

    def fold(angle):
        other = [0.5, -np.cos(angle), -np.sin(angle)]
        return np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1, 0], other])

    return sk.Mesh(fold(0.5), [[0, 1, 2], [1, 0, 3]]), fold


@pytest.fixture(scope="module")
def generic():
    """A sphere with every vertex moved at random: no symmetry, no equal lengths, dents."""
    sphere = sk.meshes.icosphere(subdivisions=1)
    return sphere.with_vertices(sphere.vertices + 0.05 * np.random.default_rng(3).normal(size=(42, 3)))
