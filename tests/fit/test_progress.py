"""What a running fit shows: a bar on terminals only, lines of JSON, curves."""

import io
import json
import math
import sys
import types

import jax.numpy as jnp
import numpy as np
import optax
import pytest

from shellkit._fit.choices import WarmStart
from shellkit._fit.fit import fit
from shellkit._fit.observers import JsonLines, TensorBoard


def test_quiet_where_there_is_no_terminal(make_quadratic, angle, capfd):
    fit(make_quadratic(), optax.sgd(0.1), steps=5, where=angle, progress=True)
    assert capfd.readouterr() == ("", "")


def test_a_bar_with_the_terms_on_a_terminal(make_quadratic, angle, monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "160")
    result = fit(make_quadratic(), optax.sgd(0.1), steps=5, where=angle, progress=True)
    shown = screen.getvalue()
    assert "5/5" in shown and "Distance" in shown and "Size" in shown and ("steps/s" in shown or "s/step" in shown)
    assert f"{result.history['loss'][-1]:.3e}" in shown


def test_rich_is_imported_on_use_only(make_quadratic, angle, monkeypatch):
    monkeypatch.setitem(sys.modules, "rich.progress", None)
    fit(make_quadratic(), optax.sgd(0.1), steps=2, where=angle, progress=False)


def test_log_of_each_step(make_quadratic, angle, tmp_path):
    log = tmp_path / "deep" / "log.jsonl"
    with pytest.warns(UserWarning, match="refused"):
        problem = make_quadratic(1, limit=jnp.asarray(0.5))
        result = fit(
            problem,
            optax.sgd(0.4),
            steps=6,
            where=angle,
            callbacks=[JsonLines(log)],
            warm_start=WarmStart(check_every=2),
        )
    rows = [json.loads(line) for line in log.read_text().splitlines()]
    assert [row.pop("step") for row in rows] == list(range(6))
    for name in result.history:
        logged = [math.nan if row[name] is None else row[name] for row in rows]
        np.testing.assert_array_equal(logged, result.history[name])
    fit(problem, optax.sgd(0.1), steps=2, where=angle, callbacks=[JsonLines(log)])
    assert len(log.read_text().splitlines()) == 8


def test_tensorboard(make_quadratic, angle, monkeypatch):
    written = []

    class SummaryWriter:
        def __init__(self, folder):
            written.append(folder)

        def add_scalar(self, name, value, step):
            written.append((name, value, step))

        def close(self):
            written.append("closed")

    monkeypatch.setitem(sys.modules, "tensorboardX", types.SimpleNamespace(SummaryWriter=SummaryWriter))
    result = fit(make_quadratic(), optax.sgd(0.1), steps=3, where=angle, callbacks=[TensorBoard("runs")])
    assert written[0] == "runs" and written[-1] == "closed"
    assert [value for name, value, _ in written[1:-1] if name == "loss"] == list(result.history["loss"])


def test_tensorboard_absent(monkeypatch):
    monkeypatch.setitem(sys.modules, "tensorboardX", None)
    with pytest.raises(ImportError, match=r"pip install 'shellkit-jax\[tensorboard\]'"):
        TensorBoard("runs")
