"""Card 11 of the validation: a flat nematic disc that becomes a cone, on edges shorter than the sheet is thick."""

import pytest

from validation.cards import cones


@pytest.mark.slow
def test_disc_becomes_the_cone():
    equilibrium = cones.cone("azimuthal", 0.016)()
    assert equilibrium.converged
    assert equilibrium.stable
    angle, height, energy = cones.EXACT["azimuthal"]
    ours = cones.shape(equilibrium)
    assert abs(ours[0] - angle) < 0.3
    assert abs(ours[1] - height) < 5e-3
    assert abs(float(equilibrium.energy) / energy - 1) < 2e-2
