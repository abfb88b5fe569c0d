"""Hard cases of every kind: nothing is not finite, nothing claims falsely to have converged."""

import numpy as np
import pytest

from validation.stability.cases import (
    KINDS,
    MATERIALS,
    bent,
    cones,
    pressurised,
    random_sheets,
    strips,
    thicknesses,
    units,
)
from validation.stability.verdict import judge


FREE = "neo-Hookean, tan, free"


@pytest.fixture(scope="module")
def verdicts():
    """A few cases of each kind with free directors; those with a mesh of their own would be compiled apart."""
    kinds = {name: kind for name, kind in KINDS.items() if kind[0] not in (strips, cones, pressurised)}
    return {name: [judge(case) for case in cases(FREE, min(count, 6))] for name, (cases, count) in kinds.items()}


def test_nothing_is_infinite_or_untrue(verdicts):
    for kind, judged in verdicts.items():
        for verdict in judged:
            assert verdict.finite and verdict.honest, (kind, verdict)


@pytest.mark.parametrize("kind", ["starts with noise", "starts with crushed faces", "starts folded"])
def test_starts_lead_to_an_equilibrium(verdicts, kind):
    lowest = min(verdict.energy for verdict in verdicts[kind])
    for verdict in verdicts[kind]:
        assert verdict.converged, verdict
        if verdict.label == "noise 0.1":
            assert np.isclose(verdict.energy, lowest, rtol=1e-9)


def test_steps_do_not_depend_on_the_unit_of_length(verdicts):
    steps = [verdict.steps for verdict in verdicts["unit of length from 1e-6 to 1e6"]]
    assert all(verdict.converged for verdict in verdicts["unit of length from 1e-6 to 1e6"])
    assert max(steps) <= min(steps) + 2


@pytest.mark.slow
@pytest.mark.parametrize("material", sorted(MATERIALS))
def test_strip_of_any_thickness(material):
    """At once from flat, in a number of steps that does not depend on the thickness, to a shape that hardly does."""
    judged = [judge(case) for case in strips(material, 5)]
    assert all(verdict.converged and verdict.honest for verdict in judged), judged
    assert max(verdict.steps for verdict in judged) <= 3 * min(verdict.steps for verdict in judged)
    # The load goes with h³, and the strip bends without stretching: so does the energy.
    thin = [verdict.energy / thickness**3 for verdict, thickness in zip(judged[2:], (1e-3, 1e-4, 1e-5), strict=True)]
    np.testing.assert_allclose(thin, thin[-1], rtol=3e-3)


@pytest.mark.slow
@pytest.mark.parametrize("material", sorted(MATERIALS))
def test_flat_disc_leaves_its_saddle(material):
    """At once, however strongly it is actuated, and not through crumpled states."""
    mildest, *_, strongest = cones(material, 6)
    for case in (mildest, strongest):
        verdict = judge(case)
        assert verdict.converged and verdict.honest and verdict.steps < 25, verdict


@pytest.mark.slow
def test_sphere_near_its_critical_pressure():
    """Far below it stays a sphere; near and beyond it ends somewhere, or says that it does not."""
    judged = [judge(case) for case in pressurised(FREE)]
    assert all(verdict.finite and verdict.honest for verdict in judged)
    assert judged[0].converged and judged[0].steps < 5


@pytest.mark.slow
@pytest.mark.parametrize("material", sorted(MATERIALS))
def test_random_sheets(material):
    """Many more random meshes, and thin ones that do not fit."""
    for case in (*random_sheets(material, 45, seed=1), *thicknesses(material)):
        verdict = judge(case)
        assert verdict.finite and verdict.honest, verdict


def test_judge_tells_a_minimum_from_what_is_none():
    """The judge itself: a shell that was not relaxed is at no equilibrium, one at rest is."""
    from validation.stability.verdict import _at

    problem = bent(FREE)
    assert _at(problem, problem.unrelaxed())[0] > 1e-3
    assert len(list(units(FREE, 3))) == 3
