"""Energies of degenerate faces are finite with their derivatives, and do not depend on where the shell lies."""

import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import shellkit as sk
from shellkit._energy import Unknowns


ENERGIES = {
    "neo-Hookean, tan, free": lambda: (
        sk.NeoHookean.from_young(1.0, 0.3) + sk.Bending.from_young(1.0, 0.3, form="tan", directors="free")
    ),
    "StVK, sin, average": lambda: sk.StVenantKirchhoff.from_young(1.0, 0.3) + sk.Bending.from_young(1.0, 0.3),
}
FACES = np.array([[0, 1, 2], [1, 0, 3], [2, 1, 4]])
numbers = functools.partial(st.floats, allow_nan=False, allow_infinity=False)


@eqx.filter_jit
def derivatives(problem, vertices):
    """One compiled program for each energy, whatever the positions: they are arrays."""
    energy = problem.discrete_energy()
    unknowns = problem.assembly.dofs.gather(Unknowns(vertices))
    return energy(unknowns), energy.gradient(unknowns), energy.hessian(unknowns).values


def shell(name, points, thickness=0.1):
    return sk.InverseProblem(sk.Mesh(points, FACES), thickness, ENERGIES[name]())


def hinge(height, foot, fold, reach=1.0):
    """Three faces: the first over the edge from 0 to 1 with its corner at a foot and a height, the second folded."""
    return np.array(
        [
            [0, 0, 0],
            [1, 0, 0],
            [foot, height, 0],
            [0.4, -reach * np.cos(fold), reach * np.sin(fold)],
            [1.3, 0.9, 0.4],
        ]
    )


@pytest.mark.parametrize("name", sorted(ENERGIES))
@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    height=numbers(-4, 0),
    foot=numbers(-2, 3),
    fold=numbers(0, np.pi),
    thickness=numbers(-5, -1),
    stretch=numbers(np.log(0.3), np.log(3.0)),
    seed=st.integers(0, 1000),
)
def test_needles_and_folds_are_finite(name, height, foot, fold, thickness, stretch, seed):
    """Heights down to 1e-4 of the edge are aspect ratios to 1e4 and angles to 179.98 degrees."""
    rest = hinge(10.0**height, foot, 0.3)
    now = np.exp(stretch) * hinge(10.0**height, foot, fold)
    now += 0.01 * 10.0**height * np.random.default_rng(seed).normal(size=now.shape)
    for part in derivatives(shell(name, rest, 10.0**thickness), jnp.asarray(now)):
        assert jnp.isfinite(part).all()


@pytest.mark.parametrize("name", sorted(ENERGIES))
@settings(max_examples=25, deadline=None, derandomize=True)
@given(seed=st.integers(0, 1000), scale=numbers(-6, 6), thickness=numbers(-5, -1))
def test_rotation_and_scale_change_no_digit(name, seed, scale, thickness):
    random = np.random.default_rng(seed)
    rest = hinge(0.7, 0.3, 0.4)
    now = rest + 0.2 * random.normal(size=rest.shape)
    rotation = np.linalg.qr(random.normal(size=(3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    factor, h = 10.0**scale, 10.0**thickness
    energy = float(derivatives(shell(name, rest, h), jnp.asarray(now))[0])
    turned = float(derivatives(shell(name, factor * rest, factor * h), jnp.asarray(factor * now @ rotation.T))[0])
    assert np.isclose(turned / factor**3, energy, rtol=1e-10)


@pytest.mark.parametrize("name", sorted(ENERGIES))
def test_translation_costs_what_the_coordinates_lose_and_no_more(name):
    """Far away, coordinates are rounded to 1e-10. The energy there is that of the rounded shell, to the last digits:
    it is made of differences, which are exact."""
    rest = hinge(0.7, 0.3, 0.4)
    now = rest + 0.2 * np.random.default_rng(0).normal(size=rest.shape)
    far = now + 1e6
    rounded = far - 1e6
    energies = [float(derivatives(shell(name, rest), jnp.asarray(x))[0]) for x in (now, far, rounded)]
    assert np.isclose(energies[1], energies[2], rtol=1e-14)
    assert np.isclose(energies[1], energies[0], rtol=1e-6)
