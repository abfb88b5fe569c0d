"""Card 1 of the validation: what the moduli mean."""

import pytest

from validation.cards import moduli


TOLERANCES = {
    "energy under uniaxial stress": 1e-3,  # of the strain, which is not infinitesimal
    "strain across over strain along": 1e-3,
    "energy of a large affine map": 1e-12,
    "bending energy, D/2": 1e-12,
    "difference of the Hessians at rest": 1e-12,
}


def test_moduli_mean_what_the_formulas_say():
    figures = list(moduli.measure(1))
    assert {figure.quantity for figure in figures} == set(TOLERANCES)
    for figure in figures:
        assert abs(figure.error) < TOLERANCES[figure.quantity], figure


@pytest.mark.parametrize("directors", ["free", "average"])
def test_flat_sheet_has_no_curvature_of_its_own(directors):
    """The library's forms agree with those of a chart, at a place where both are known."""
    problem = moduli.patch(moduli.sk.Bending(1.0, 1.0, directors=directors))
    assert float(problem.total_energy(problem.mesh.vertices)) == 0.0
