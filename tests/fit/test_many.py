"""Many fits: in this process, in threads, in processes of their own, with failures, and taken up again."""

import functools
import multiprocessing
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optax
import optimistix as optx
import pytest

import shellkit as sk
from shellkit._fit.checkpoint import Checkpoint
from shellkit._fit.choices import Refuse
from shellkit._fit.fit import fit
from shellkit._fit.many import fit_many
from shellkit._fit.observers import Stop


# Where other processes find it, too.
sys.path.append(str(Path(__file__).parent))
from starts import Well, well


SGD = optax.sgd(0.05)
STEEP = optax.sgd(0.25)
KEYS = [0, 1, 2, 4, 5, 6]
trained = lambda p: p.actuation


def test_each_start_finds_the_minimum_of_its_basin():
    gathered = []
    many = fit_many(KEYS, SGD, steps=60, make=well, where=trained, gathered=lambda n, r: gathered.append(n))
    starts = np.array([float(well(key).actuation[0]) for key in KEYS])
    found = np.array([float(result.problem.actuation[0]) for result in many.results])
    # Minima of (x² - 1)² + 0.1 (1 - x): roots of 4x³ - 4x - 0.1.
    roots = np.sort(np.roots([4, 0, -4, -0.1]).real)
    assert (starts < roots[1]).any() and (starts > roots[1]).any()
    np.testing.assert_allclose(found, np.where(starts < roots[1], roots[0], roots[2]), atol=1e-3)
    assert many.best is many.results[int(np.argmin(many.losses))] and gathered == list(range(len(KEYS)))
    alone = fit(well(KEYS[0]), SGD, steps=60, where=trained)
    np.testing.assert_array_equal(many.results[0].history["loss"], alone.history["loss"])


def test_a_failure_stays_alone():
    problems = [well(2), Well(jnp.array([jnp.nan])), well(4)]
    for many in (
        fit_many(problems, SGD, steps=3, where=trained),
        fit_many(problems, SGD, steps=3, where=trained, executor=ThreadPoolExecutor(1)),
    ):
        assert set(many.failures) == {1} and "cannot begin" in str(many.failures[1])
        assert many.results[1] is None and np.isnan(many.losses[1]) and "2 of 3 done, 1 failed" in repr(many)
    nothing = fit_many(problems[1:2], SGD, steps=3, where=trained)
    with pytest.raises(ValueError, match="no fit has a result; 1 failed"):
        _ = nothing.best


class Cliff(eqx.Module):
    """A double well that has no loss beyond 2.2."""

    actuation: jnp.ndarray

    def objective(self, start=None):
        x = self.actuation
        loss = jnp.sum(jnp.where(jnp.abs(x) < 2.2, (x**2 - 1) ** 2, jnp.nan))
        return loss, ({"Cliff": loss}, None)


@pytest.mark.parametrize("how", ["map", "vmap"])
def test_together_each_goes_its_own_way(how):
    problems = [Cliff(jnp.array([x])) for x in (-1.2, jnp.nan, 1.9, 0.3)]
    with pytest.warns(UserWarning, match="was refused"):
        alone = fit_many(problems, STEEP, steps=6, where=trained)
    # A step that leaves the domain is halved by the fit that took it, and by no other.
    assert alone.results[2].history["refused"].sum() > 0 == alone.results[0].history["refused"].sum()
    gathered = []
    many = fit_many(problems, STEEP, steps=6, where=trained, together=how, gathered=lambda n, r: gathered.append(n))
    assert set(many.failures) == {1} and "cannot begin" in str(many.failures[1]) and sorted(gathered) == [0, 1, 2, 3]
    for found, exact in zip(many.results, alone.results, strict=True):
        if exact is None:
            assert found is None
            continue
        assert set(found.history) == set(exact.history) and found.stopped == "steps"
        for column in ("loss", "refused", "update_scale", "gradient_norm"):
            np.testing.assert_allclose(found.history[column], exact.history[column], rtol=1e-12)
        np.testing.assert_allclose(found.problem.actuation, exact.problem.actuation, rtol=1e-12)
        np.testing.assert_allclose(found.last_problem.actuation, exact.last_problem.actuation, rtol=1e-12)
        assert (found.best_loss, found.best_step) == (pytest.approx(exact.best_loss, rel=1e-12), exact.best_step)


def test_together_starts_are_made_and_those_that_cannot_be_fail():
    many = fit_many([2, 3, 4], functools.partial(optax.sgd, 0.05), steps=4, make=well, where=trained, together="map")
    exact = fit_many([2, 4], SGD, steps=4, make=well, where=trained)
    np.testing.assert_allclose(many.losses[[0, 2]], exact.losses, rtol=1e-12)
    assert list(many.failures) == [1] and "no start of number 3" in str(many.failures[1])


@pytest.mark.parametrize(
    ("problems", "options", "message"),
    [
        ([2], {"together": "map", "folder": "starts"}, "neither an executor nor a folder"),
        ([2], {"together": "map", "callbacks": [Stop(patience=3)]}, "no option 'callbacks'"),
        ([2], {"together": "map", "refuse": Refuse(rise=1.0)}, "no Refuse"),
        ([2], {"together": "map", "method": optx.Dogleg(1e-3, 1e-3)}, "optax's optimisers alone.*got Dogleg"),
        ([0, 1], {"together": "map", "make": lambda n: Well(jnp.zeros(n + 1))}, "must be of one kind"),
    ],
)
def test_together_what_does_not_fit(problems, options, message):
    options = {"method": SGD, "make": well, "where": trained, "steps": 2} | options
    with pytest.raises(ValueError, match=message):
        fit_many(problems, **options)


@pytest.mark.slow
def test_together_shells():
    """Relaxations in turn, one of which does not converge; a sparse solver is not batched."""
    mesh = sk.meshes.icosphere(subdivisions=0)
    problem = sk.InverseProblem(
        mesh=mesh,
        thickness=0.1,
        actuation=sk.Nematic(angle=jnp.zeros(mesh.n_faces), stretch=1.1),
        energy=sk.StVenantKirchhoff(alpha=1.0, beta=1.0) + sk.Bending(alpha=1.0, beta=1.0),
        loss=sk.VertexDistance(mesh.vertices * jnp.array([0.95, 0.95, 1.1])),
    )
    angle, adam = lambda p: p.actuation.angle, optax.adam(0.1)
    angles = np.random.default_rng(0).uniform(0, np.pi, (3, mesh.n_faces))
    angles[1, 0] = np.nan
    starts = [eqx.tree_at(angle, problem, jnp.asarray(start)) for start in angles]
    many = fit_many(starts, adam, steps=3, where=angle, together="map")
    assert set(many.failures) == {1}
    for n in (0, 2):
        assert many.results[n].history["converged"].all() and (np.diff(many.results[n].history["loss"]) < 0).all()
    with pytest.raises(ValueError, match=r'cannot be batched.*together="map"'):
        fit_many(starts, adam, steps=3, where=angle, together="vmap")


def test_taken_up_where_they_stood(tmp_path):
    straight = fit_many(KEYS[:3], SGD, steps=12, make=well, where=trained)
    fit_many(KEYS[:2], SGD, steps=5, make=well, where=trained, folder=tmp_path)
    for _ in range(2):
        again = fit_many(KEYS[:3], SGD, steps=12, make=well, where=trained, folder=tmp_path)
        for result, exact in zip(again.results, straight.results, strict=True):
            np.testing.assert_array_equal(result.history["loss"], exact.history["loss"])
            np.testing.assert_array_equal(result.problem.actuation, exact.problem.actuation)
    # The last round only read: no fit has a state.
    assert all(result.state is None for result in again.results)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["start-0000", "start-0001", "start-0002"]


def test_ended_fits_are_not_taken_up(tmp_path):
    stop = Stop(patience=3, tolerance=0.5)
    options = {"make": well, "where": trained, "folder": Checkpoint(tmp_path, every=2), "callbacks": [stop]}
    first = fit_many(KEYS[:1], SGD, steps=50, **options).results[0]
    again = fit_many(KEYS[:1], SGD, steps=50, **options).results[0]
    assert first.stopped == again.stopped == "plateau" and first.history.steps == again.history.steps


class Jobs:
    """An executor of another kind, as submitit's: its jobs are no futures, and end in their own time."""

    class Job:
        def __init__(self, call):
            self.call, self.end = call, time.monotonic() + 0.3

        def done(self):
            return time.monotonic() > self.end

        def result(self):
            return self.call()

        def cancel(self):
            raise AssertionError("cancelled")

    def submit(self, function, *arguments):
        return self.Job(lambda: function(*arguments))


def test_jobs_that_are_no_futures():
    many = fit_many(KEYS[:2], SGD, steps=4, make=well, where=trained, executor=Jobs())
    exact = fit_many(KEYS[:2], SGD, steps=4, make=well, where=trained)
    np.testing.assert_array_equal(many.losses, exact.losses)


@pytest.mark.slow
def test_processes(monkeypatch, tmp_path):
    monkeypatch.setenv("JAX_ENABLE_X64", "1")
    make = functools.partial(optax.sgd, 0.05)
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        # The first is made here as well, to see what there is to be trained.
        many = fit_many([2, 3, 4], make, steps=4, make=well, where=trained, executor=pool, folder=tmp_path)
        sent = fit_many([well(2)], make, steps=4, where=trained, executor=pool)
        with pytest.raises(ValueError, match=r"method cannot be sent.*functools\.partial"):
            fit_many([2], SGD, steps=4, make=well, where=trained, executor=pool)
    exact = fit_many([2, 4], SGD, steps=4, make=well, where=trained)
    np.testing.assert_allclose(many.losses[[0, 2]], exact.losses, rtol=1e-12)
    np.testing.assert_allclose(sent.losses, exact.losses[:1], rtol=1e-12)
    assert list(many.failures) == [1] and "no start of number 3" in str(many.failures[1])
    assert many.results[0].history.steps == 4
    np.testing.assert_allclose(many.results[0].last_problem.actuation, exact.results[0].last_problem.actuation)


@pytest.mark.parametrize(
    ("problems", "options", "message"),
    [([], {}, "no problems"), (KEYS[:1], {"make": well, "checkpoint": "run"}, "folder=")],
)
def test_options_that_do_not_fit(problems, options, message):
    with pytest.raises(ValueError, match=message):
        fit_many(problems, optx.LevenbergMarquardt(1e-3, 1e-3), steps=2, where=trained, **options)


def test_from_workers_all_of_the_actuation_is_trained_as_well():
    """Without `where`, results that were sent back are those found here."""
    many = fit_many([2, 4], SGD, steps=4, make=well, executor=ThreadPoolExecutor(1))
    exact = fit_many([2, 4], SGD, steps=4, make=well)
    for found, here in zip(many.results, exact.results, strict=True):
        np.testing.assert_array_equal(found.problem.actuation, here.problem.actuation)
        np.testing.assert_array_equal(found.history["loss"], here.history["loss"])
