"""The keywords of the last release: each warns, names what takes its place, and does the same."""

import json
import sys
import types

import jax.numpy as jnp
import numpy as np
import optax
import pytest

import shellkit as sk


SGD = optax.sgd(0.2)


def same(one, other):
    assert one.stopped == other.stopped and set(one.history) == set(other.history)
    for name in set(one.history) - {"seconds"}:
        np.testing.assert_array_equal(one.history[name], other.history[name])


def old(names, *arguments, function=sk.fit, **options):
    """A call in the old way, which warns once for each of its old keywords, and of nothing else that is deprecated."""
    with pytest.warns(DeprecationWarning) as caught:
        result = function(*arguments, **options)
    told = [str(w.message) for w in caught if issubclass(w.category, DeprecationWarning)]
    assert len(told) == len(names)
    for name in names:
        assert any(f"{function.__name__}({name}=…) is deprecated" in message for message in told)
    return result


@pytest.mark.filterwarnings("ignore:fit. stopped:UserWarning", "ignore:fit. the design:UserWarning")
@pytest.mark.parametrize(
    ("retired", "present"),
    [
        ({"patience": 5}, {"callbacks": [sk.Stop(patience=5)]}),
        ({"patience": 5, "tolerance": 1e-2}, {"callbacks": [sk.Stop(patience=5, tolerance=1e-2)]}),
        ({"max_seconds": 1e-9}, {"callbacks": [sk.Stop(seconds=1e-9)]}),
        ({"max_refusals": 1}, {"refuse": sk.Refuse(most=1)}),
        ({"max_rise": 0.1, "max_refusals": 9}, {"refuse": sk.Refuse(rise=0.1, most=9)}),
        ({"unconverged": "accept"}, {"refuse": sk.Refuse(unconverged=False)}),
        ({"unconverged": "refuse"}, {}),
        ({"warm_start": "rest", "check_every": 3}, {}),
        ({"warm_start": "last"}, {"warm_start": sk.WarmStart()}),
        ({"warm_start": "predicted", "check_every": 3}, {"warm_start": sk.WarmStart("predicted", check_every=3)}),
        ({"log": None, "tensorboard": None}, {}),
        ({"checkpoint_every": 3}, {}),
    ],
    ids=lambda options: ", ".join(options),
)
def test_does_the_same(make_quadratic, angle, retired, present):
    # Beyond 0.7 no relaxation converges: the third step of the second angle goes there.
    problem = make_quadratic(2, limit=jnp.asarray(0.7))
    options = {"steps": 12, "where": angle}
    same(old(retired, problem, SGD, **options, **retired), sk.fit(problem, SGD, **options, **present))


def test_the_optimiser_by_name(make_quadratic, angle):
    found = old(["optimiser"], make_quadratic(), optimiser=SGD, steps=3, where=angle)
    same(found, sk.fit(make_quadratic(), method=SGD, steps=3, where=angle))


def test_checkpoints(make_quadratic, angle, tmp_path):
    def stop(info):
        # The fit of three steps in all is on the disk when the fourth begins.
        if info.step == 3:
            steps.append(sk.load_checkpoint(tmp_path / "run", make_quadratic()).history.steps)

    steps = []
    options = {"steps": 5, "where": angle, "checkpoint": tmp_path / "run", "callbacks": [stop]}
    old(["checkpoint_every"], make_quadratic(), SGD, checkpoint_every=3, **options)
    assert steps == [3]


def test_reporters(make_quadratic, angle, monkeypatch, tmp_path):
    written = []
    writer = lambda folder: types.SimpleNamespace(add_scalar=lambda *row: written.append(row), close=lambda: None)
    monkeypatch.setitem(sys.modules, "tensorboardX", types.SimpleNamespace(SummaryWriter=writer))
    log, seen = tmp_path / "log.jsonl", []
    options = {"log": log, "tensorboard": "runs", "callbacks": [lambda info: seen.append(info.step)]}
    result = old(["log", "tensorboard"], make_quadratic(), SGD, steps=4, where=angle, **options)
    losses = list(result.history["loss"])
    assert [json.loads(line)["loss"] for line in log.read_text().splitlines()] == losses
    assert [value for name, value, _ in written if name == "loss"] == losses and seen == [0, 1, 2, 3]


def test_new_and_old_together(make_quadratic, angle):
    options = {"refuse": sk.Refuse(unconverged=False), "warm_start": sk.WarmStart("predicted")}
    found = old(
        ["max_rise", "check_every"], make_quadratic(), SGD, steps=5, where=angle, max_rise=0.5, check_every=2, **options
    )
    options = {"refuse": sk.Refuse(unconverged=False, rise=0.5), "warm_start": sk.WarmStart("predicted", check_every=2)}
    same(found, sk.fit(make_quadratic(), SGD, steps=5, where=angle, **options))


def test_many(make_quadratic, angle, tmp_path):
    problems, retired = [make_quadratic()], {"optimiser": SGD, "checkpoint_every": 2, "patience": 2}
    found = old(retired, problems, function=sk.fit_many, steps=5, where=angle, folder=tmp_path, **retired)
    exact = sk.fit_many(problems, SGD, steps=5, where=angle, callbacks=[sk.Stop(patience=2)])
    same(found.results[0], exact.results[0])
    assert [path.name for path in tmp_path.iterdir()] == ["start-0000"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"warm_start": "first"}, "warm_start must be one of 'rest', 'last', 'predicted'; got 'first'"),
        ({"unconverged": "maybe"}, "unconverged must be one of 'refuse', 'accept'; got 'maybe'"),
        ({"checkpoint_every": 0}, "every must be a whole number"),
        ({"check_every": 0}, "check_every must be a whole number"),
        ({"max_refusals": -1}, "most must be a whole number"),
    ],
)
def test_out_of_range(make_quadratic, angle, options, message):
    with pytest.raises(ValueError, match=message):
        sk.fit(make_quadratic(), SGD, steps=3, where=angle, **options)
    with pytest.raises(TypeError, match="unexpected keyword argument"):
        sk.fit(make_quadratic(), SGD, steps=3, where=angle, never_there=1)
