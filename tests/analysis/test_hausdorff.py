"""The distance report, where distances are known."""

import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk


def test_parallel_planes():
    here = sk.meshes.rectangle(2.0, 1.0, cells=(4, 2))
    there = sk.meshes.rectangle(2.0, 1.0, cells=(3, 3))
    found = sk.hausdorff(here.vertices + jnp.array([0.0, 0.0, 0.25]), here, there)
    lengths = (found.to_target, found.from_target, found.mean_to_target, found.mean_from_target, found.distance)
    assert np.allclose(lengths, 0.25, rtol=1e-13)
    assert np.isclose(found.relative_mean, 0.25 / np.sqrt(5), rtol=1e-13)
    assert "11.180 %" in str(found)


def test_concentric_spheres():
    inner, outer = sk.meshes.icosphere(3), sk.meshes.icosphere(3, radius=1.25)
    found = sk.hausdorff(outer.vertices, outer, inner)
    flatness = 1 - np.linalg.norm(np.asarray(inner.vertices)[np.asarray(inner.faces)].mean(axis=1), axis=1).min()
    for length in (found.to_target, found.from_target, found.mean):
        assert abs(length - 0.25) < 1.25 * flatness


def test_a_spike_and_a_part():
    """The mean is over areas, the largest distance sees a corner, and a part is at no distance from its whole."""
    whole = sk.meshes.rectangle(2.0, 1.0, cells=(2, 1))
    part = sk.meshes.rectangle(1.0, 1.0, cells=(1, 1))
    found = sk.hausdorff(part.vertices, part, whole, samples=40_000)
    assert max(found.to_target, found.mean_to_target) < 1e-15
    assert np.isclose(found.from_target, 1, rtol=1e-14)
    assert np.isclose(found.mean_from_target, 0.25, rtol=1e-2)
    assert found.spacing < 0.02


def test_what_cannot_be_measured():
    mesh = sk.meshes.icosphere(0)
    with pytest.raises(ValueError, match=r"shape \(5, 3\)"):
        sk.hausdorff(np.zeros((5, 3)), mesh, mesh)
    with pytest.raises(ValueError, match="not all finite"):
        sk.hausdorff(np.full((12, 3), np.nan), mesh, mesh)
