"""A fit on disk: resumed exactly, safe at any moment, and never mistaken for another."""

import importlib.util
import os
import random
import shutil
import subprocess
import sys
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

import shellkit
from shellkit._fit.checkpoint import Checkpoint, load_checkpoint
from shellkit._fit.choices import WarmStart
from shellkit._fit.fit import fit


def same(one, other):
    assert set(one.history) == set(other.history)
    for name in set(one.history) - {"seconds"}:
        np.testing.assert_array_equal(one.history[name], other.history[name])
    assert eqx.tree_equal(one.problem, other.problem) and eqx.tree_equal(one.last_problem, other.last_problem)
    assert (one.best_loss, one.best_step) == (other.best_loss, other.best_step)
    key = lambda leaf: jax.random.key_data(leaf) if jax.dtypes.issubdtype(leaf.dtype, jax.dtypes.prng_key) else leaf
    assert eqx.tree_equal(jax.tree.map(key, one.state), jax.tree.map(key, other.state))


@pytest.mark.parametrize(
    "make",
    [
        lambda: optax.adam(optax.cosine_decay_schedule(0.3, 20)),
        lambda: optax.chain(optax.add_noise(0.1, 0.5, key=jax.random.key(1)), optax.sgd(0.1)),
        optax.lbfgs,
    ],
    ids=["schedule", "random", "lbfgs"],
)
def test_resumes_exactly(make_quadratic, angle, tmp_path, make):
    optimiser = make()

    def run(steps, **options):
        problem = make_quadratic(weight=jnp.array([1.0, 10.0, 100.0]))
        return fit(problem, optimiser, steps=steps, where=angle, **options)

    for steps in (5, 6, 14):
        resumed = run(steps, checkpoint=tmp_path / "run")
    same(resumed, run(14))
    assert (np.diff(resumed.history["seconds"]) > 0).all()


def test_resumes_exactly_amid_refusals(make_quadratic, angle, tmp_path):
    def run(steps, **options):
        problem = make_quadratic(1, limit=jnp.asarray(0.3))
        optimiser = optax.sgd(lambda step: jnp.where(step == 2, 1.0, 1e-3))
        return fit(problem, optimiser, steps=steps, where=angle, **options)

    run(3, checkpoint=tmp_path / "run")
    with pytest.warns(UserWarning, match="refused"):
        run(4, checkpoint=tmp_path / "run")
        resumed, straight = run(8, checkpoint=tmp_path / "run"), run(8)
    assert resumed.history["refused"].any()
    same(resumed, straight)


def test_a_finished_fit_is_read_back(make_quadratic, angle, tmp_path):
    run = lambda steps: fit(
        make_quadratic(), optax.adam(0.1), steps=steps, where=angle, checkpoint=tmp_path / "new" / "run"
    )
    done = run(6)
    same(done, run(6))
    again = run(4)
    assert again.history.steps == 6 and again.stopped == "steps"


@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError])
def test_is_written_when_a_fit_breaks_off(make_quadratic, angle, tmp_path, error):
    def stop(info):
        if info.step == 4:
            raise error

    def run(*callbacks):
        path = tmp_path / "run"
        return fit(make_quadratic(), optax.adam(0.1), steps=9, where=angle, checkpoint=path, callbacks=callbacks)

    if error is KeyboardInterrupt:
        assert run(stop).stopped == "interrupted"
    else:
        with pytest.raises(error):
            run(stop)
    assert load_checkpoint(tmp_path / "run", make_quadratic()).history.steps == 4
    same(run(), fit(make_quadratic(), optax.adam(0.1), steps=9, where=angle))


@pytest.mark.parametrize("name", ["adam", "warm"])
def test_one_of_the_last_release_is_resumed(make_quadratic, make_wells, angle, tmp_path, name):
    """Written after four steps, before a fit was told of its choices by modules."""
    make, optimiser, options = {
        "adam": (make_quadratic, optax.adam(0.1), {}),
        "warm": (lambda: make_wells(0.3, 1.3), optax.adam(0.05), {"warm_start": WarmStart("predicted", check_every=3)}),
    }[name]
    kept = Path(__file__).parent / "kept" / name
    shutil.copy(kept, tmp_path / "run")
    run = lambda **more: fit(make(), optimiser, steps=8, where=angle, **options, **more)
    resumed, straight = run(checkpoint=tmp_path / "run"), run()
    assert resumed.history["seconds"][3] == load_checkpoint(kept, make()).history["seconds"][3]
    for column in set(straight.history) - {"seconds", "warm_gap", "relaxation_gradient_norm"}:
        np.testing.assert_allclose(resumed.history[column], straight.history[column], rtol=1e-9)


def test_load_checkpoint(make_quadratic, angle, tmp_path):
    where = lambda p: (p.actuation.angle, p.weight)
    path = tmp_path / "run"
    result = fit(make_quadratic(), optax.lbfgs(), steps=7, where=where, checkpoint=path)
    # The values of what was trained do not matter in the problem to load into.
    read = load_checkpoint(path, make_quadratic(start=9.0))
    assert eqx.tree_equal(read.problem, result.problem) and eqx.tree_equal(read.last_problem, result.last_problem)
    assert read.history.lists() == result.history.lists()
    assert (read.best_loss, read.best_step, read.stopped) == (result.best_loss, result.best_step, "steps")
    with pytest.raises(ValueError, match=r"problem\.target: .* norm 0 here"):
        load_checkpoint(path, make_quadratic(target=jnp.zeros(3)))
    with pytest.raises(FileNotFoundError):
        load_checkpoint(tmp_path / "absent", make_quadratic())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"n": 4}, r"trained.actuation.angle: float64\[3\] in the checkpoint, float64\[4\] here"),
        ({"target": jnp.array([1.0, 2.0, 3.1])}, "problem.target: float64.*norm 3.74.* in the checkpoint"),
        ({"target": jnp.array([3.0, 2.0, 1.0])}, "problem.target: other values"),
        ({"count": jnp.asarray(3)}, r"problem.count: int64\[\]"),
        ({"kind": "fancy"}, "problem.kind: 'plain' in the checkpoint, 'fancy' here"),
        ({"start": 0.5}, "start.actuation.angle"),
        ({"optimiser": optax.sgd(0.1)}, "optimiser.0.mu.actuation.angle: .* absent here"),
        ({"where": lambda p: p.weight}, "trained.weight: absent in the checkpoint"),
        ({"warm_start": WarmStart()}, "choices.warm_start: rest in the checkpoint, last here"),
    ],
)
def test_another_fit_is_refused_and_the_difference_named(make_quadratic, angle, tmp_path, change, message):
    path = tmp_path / "run"
    options = {"steps": 3, "where": angle, "checkpoint": path}
    fit(make_quadratic(), optax.adam(0.1), **options)
    before = path.read_bytes()
    options |= {key: change.pop(key) for key in ("where", "warm_start") if key in change}
    optimiser = change.pop("optimiser", optax.adam(0.1))
    with pytest.raises(ValueError, match=message):
        fit(make_quadratic(**change), optimiser, **options)
    assert path.read_bytes() == before


def test_rounding_does_not_make_another_problem(make_quadratic, angle, tmp_path):
    run = lambda target: fit(
        make_quadratic(target=target), optax.adam(0.1), steps=3, where=angle, checkpoint=tmp_path / "run"
    )
    target = jnp.arange(1.0, 4)
    run(target)
    run(target * (1 + 1e-12))


def test_files_that_are_no_checkpoints_are_left_alone(make_quadratic, angle, tmp_path):
    path = tmp_path / "thesis.txt"
    path.write_text("years of work")
    with pytest.raises(ValueError, match=r"thesis.txt exists and is not a checkpoint"):
        fit(make_quadratic(), optax.sgd(0.1), steps=2, where=angle, checkpoint=path)
    assert path.read_text() == "years of work"
    with pytest.raises(ValueError, match="is a folder"):
        fit(make_quadratic(), optax.sgd(0.1), steps=2, where=angle, checkpoint=tmp_path)


@pytest.mark.parametrize("damage", [lambda b: b[:-5], lambda b: b[:-9] + b"x" + b[-8:], lambda b: b[:80]])
def test_damage_is_noticed(make_quadratic, angle, tmp_path, damage):
    path = tmp_path / "run"
    run = lambda: fit(make_quadratic(), optax.sgd(0.1), steps=2, where=angle, checkpoint=path)
    run()
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(ValueError, match="damaged"):
        run()


@pytest.mark.parametrize("broken", ["os.replace", "os.fsync"])
def test_a_crash_while_writing_leaves_the_older_one(make_quadratic, angle, tmp_path, monkeypatch, broken):
    path = tmp_path / "run"
    run = lambda steps: fit(
        make_quadratic(), optax.adam(0.1), steps=steps, where=angle, checkpoint=Checkpoint(path, every=1)
    )
    run(4)
    before = path.read_bytes()
    with monkeypatch.context() as patch:

        def crash(*_):
            raise OSError("no space left")

        patch.setattr(broken, crash)
        with pytest.raises(OSError, match="no space left"):
            run(9)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["run"]
    same(run(9), fit(make_quadratic(), optax.adam(0.1), steps=9, where=angle))


def test_half_written_files_of_a_killed_run_are_removed(make_quadratic, angle, tmp_path):
    ours, others = tmp_path / ".run.0a1b2c3d.partial", [tmp_path / ".run.2.0a1b2c3d.partial", tmp_path / ".run.partial"]
    for file in [ours, *others]:
        file.write_text("half")
    fit(make_quadratic(), optax.sgd(0.1), steps=2, where=angle, checkpoint=tmp_path / "run")
    assert not ours.exists() and all(file.exists() for file in others)


def test_a_kill_at_any_moment_leaves_a_checkpoint(tmp_path):
    program = Path(__file__).with_name("endless.py")
    spec = importlib.util.spec_from_file_location("endless", program)
    endless = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(endless)
    path = tmp_path / "run"
    root = str(Path(shellkit.__file__).parents[1])
    path_of_modules = os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])
    like = endless.Bowl(jnp.linspace(1.0, 2.0, 20_000))
    moments, steps = random.Random(0), 0
    for _ in range(3):
        process = subprocess.Popen(
            [sys.executable, str(program), str(path)], env={**os.environ, "PYTHONPATH": path_of_modules}
        )
        try:
            deadline = time.monotonic() + 60
            while not path.exists() or load_checkpoint(path, like).history.steps < steps + 3:
                assert process.poll() is None and time.monotonic() < deadline
                time.sleep(0.01)
            time.sleep(moments.uniform(0, 0.1))
        finally:
            process.kill()
            process.wait()
        left = load_checkpoint(path, like)
        assert left.stopped == "running" and left.history.steps >= steps + 3
        steps = left.history.steps
    resumed = endless.run(path, steps + 2)
    straight = endless.run(tmp_path / "straight", steps + 2)
    same(resumed, straight)
