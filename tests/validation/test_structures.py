"""Cards 7 to 10 and 13 of the validation, on coarse meshes: plates, strips, large displacements, thin curved shells and
roofs that snap through."""

import numpy as np
import pytest

import shellkit as sk
from validation.cards import elastica, large, locking, plate, roof
from validation.figures import Figure, order
from validation.linear import displacement
from validation.meshes import KINDS


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_plate_converges(kind):
    found = {cells: plate.answers(plate.plate(kind, cells)) for cells in (12, 24)}
    for name, exact in plate.EXACT.items():
        figures = [Figure(name, kind, cells, exact, answer[name], 0.0) for cells, answer in found.items()]
        assert order(figures) > 1.8
        assert abs(figures[-1].error) < 1.2e-2  # four times that of 48 cells


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_cantilever_converges(kind):
    moves = {cells: elastica.tip(elastica.relaxed(elastica.cantilever(kind, cells))[0]) for cells in elastica.SIZES[3]}
    for axis, exact in ((0, -elastica.SHORTENING), (2, elastica.DEFLECTION)):
        figures = [Figure("tip", kind, cells[0], exact, float(move[axis]), 0.0) for cells, move in moves.items()]
        assert order(figures) > 1.8
        assert abs(figures[-1].error) < 5e-3


@pytest.mark.slow
def test_hemisphere_is_moved_as_published():
    problem = large.hemisphere("J", 24)
    equilibrium = sk.relax(problem, path=sk.Ramp(10))
    assert equilibrium.converged
    for name, ours in large.moved(problem, equilibrium).items():
        assert abs(ours / large.HEMISPHERE[1.0][name] - 1) < 1e-2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "kind"), [(locking.scordelis_lo, "J"), (locking.scordelis_lo, "X"), (locking.hypar, "J")]
)
def test_curved_shells_do_not_lock(scene, kind):
    problem, read, exact = scene(kind, 32)
    assert abs(read(displacement(problem)) / exact - 1) < 2e-2


@pytest.mark.slow
def test_pinched_cylinder():
    problem, read, exact = locking.pinched_cylinder("J", 128)
    assert abs(read(displacement(problem)) / exact - 1) < 2e-2


@pytest.mark.slow
def test_narrow_hook_moves_as_a_beam():
    """Castigliano's theorem for a curved beam, bent in the stiff direction and twisted with bt³/3."""
    young, poisson, width, thickness = 3300.0, 0.35, 10.0, 2.0
    (small, first), (large, second) = locking.HOOK
    length = small * first + large * second
    along = (np.arange(20_000) + 0.5) / 20_000 * length
    tangent = np.exp(1j * np.where(along < small * first, along / small, first - (along - small * first) / large))
    place = np.cumsum(tangent) * length / len(along)
    arm = (place[-1] - place) * np.conj(tangent)  # to the tip: along the beam here, and across it
    bending = arm.real**2 / (young * thickness * width**3 / 12)
    torsion = arm.imag**2 / (young / (2 + 2 * poisson) * width * thickness**3 / 3)
    exact = np.sum(bending + torsion) * length / len(along)
    problem, read, _ = locking.raasch_hook("R", 144, width=width)
    assert abs(read(displacement(problem)) / exact - 1) < 2e-2  # the clamp keeps its end from warping


@pytest.mark.slow
def test_thick_roof_snaps_through_at_the_published_load():
    problem = roof.roof("R", 6, roof.THICK)
    first, *_ = roof.limits(roof.path(problem))
    assert abs(float(first.progress) / roof.LIMIT - 1) < 4e-2
    assert abs(roof.down(problem, first.equilibrium.vertices) / roof.DOWN - 1) < 4e-2


@pytest.mark.slow
def test_thin_roof_snaps_back():
    problem = roof.roof("R", 6, roof.THIN)
    branch = roof.path(problem)
    assert len(roof.limits(branch)) == 2
    assert roof.turns(roof.down(problem, branch.vertices)) == 2  # the middle goes back up while the load falls
    assert abs(roof.imbalance(problem, branch)) < 1e-2
