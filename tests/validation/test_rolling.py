"""Card 3 of the validation: sheets that roll up, free, clamped or kept wide, and layers made for a shape."""

import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk
from shellkit._energy import Unknowns
from validation.cards import rollup


FLAT = 0.5 * rollup.THICKNESS**3 / 12 / (1 - rollup.POISSON**2)  # energy of an area for a curvature of one


def clamped():
    """A quarter of a circle, clamped at x = 0."""
    mesh = rollup.sheet("X", (8, 2), 1.0, 0.3)
    return sk.InverseProblem(
        mesh=mesh,
        thickness=rollup.THICKNESS,
        actuation=sk.Prescribed(curvature=rollup.curvature(mesh, np.pi / 2)),
        energy=rollup.roll("X", 8).energy,
        supports=sk.Clamped(jnp.isclose(mesh.vertices[:, 0], 0.0)),
    )


def test_supports_that_hold_normals_let_nothing_turn_about_them():
    assert clamped().rigid_modes() is None
    kept = rollup.wide("X", 6)
    motions = kept.rigid_modes()
    assert motions is not None
    unknowns = kept.assembly.dofs.gather(Unknowns(kept.mesh.vertices))
    # Along x and z, and about y.
    assert np.count_nonzero(np.any(motions(unknowns), axis=0)) == 3


@pytest.mark.slow
def test_clamped_sheet_rolls_up_all_the_same():
    problem = clamped()
    equilibrium, _ = rollup.rolled(problem, 4)
    assert float(equilibrium.energy) < 1e-16 * FLAT
    end = np.asarray(equilibrium.vertices)[np.isclose(problem.mesh.vertices[:, 0], 1.0)]
    # The end of a quarter of a circle, of which the sheet is a polygon.
    np.testing.assert_allclose(np.abs(end[:, [0, 2]]), 2 / np.pi, rtol=1e-2)
    np.testing.assert_allclose(rollup.bend(equilibrium), np.pi / 2, rtol=1e-2)


@pytest.mark.slow
def test_wide_sheet_bends_one_way_only():
    equilibrium, _ = rollup.rolled(rollup.wide("X", 6), 2)
    energy = rollup.THICKNESS**3 * rollup.WIDE[1] ** 2 / 24
    np.testing.assert_allclose(float(equilibrium.energy), energy, rtol=1e-4)
    np.testing.assert_allclose(rollup.bend(equilibrium), rollup.WIDE[0] + 0.3 * rollup.WIDE[1], rtol=1e-2)


@pytest.mark.slow
def test_two_layers_bend_as_timoshenko_says():
    equilibrium, _ = rollup.rolled(rollup.timoshenko("X", 8), 1)
    np.testing.assert_allclose(rollup.bend(equilibrium), 1.5 * rollup.MISFIT / rollup.THICKNESS, rtol=1e-2)


@pytest.mark.parametrize("kind", rollup.KINDS)
def test_layers_made_for_a_shape_leave_no_energy_there(kind):
    left, flat = rollup.exact_layers(kind, 8)
    assert left < 1e-24 * flat


@pytest.mark.slow
@pytest.mark.parametrize("kind", rollup.KINDS)
def test_sheet_rolls_up_to_a_closed_cylinder(kind):
    found = [rollup.rolled(rollup.roll(kind, cells))[0] for cells in (8, 16, 32)]
    gaps = [rollup.gap(equilibrium) for equilibrium in found]
    assert -np.polyfit(np.log([8, 16, 32]), np.log(gaps), 1)[0] > 1.8
    assert gaps[-1] < 4e-3 / 2  # 1e-3 at 64 cells, at second order
    assert abs(rollup.radius(found[-1]) / rollup.RADIUS - 1) < 2e-3
    assert float(found[-1].energy) < 1e-3 * FLAT * (2 * np.pi) ** 2 * rollup.WIDTH
