"""What is said and kept of compilation, and which functions count as one."""

import io
import sys

import jax
import jax.numpy as jnp
import optax
import pytest

import shellkit as sk
from shellkit._programs.same import first_like
from shellkit._programs.waiting import announce


def test_compiled_programs_are_kept_where_it_is_said(tmp_path, monkeypatch):
    before = jax.config.jax_compilation_cache_dir, jax.config.jax_persistent_cache_min_compile_time_secs
    try:
        assert sk.keep_compiled(tmp_path / "a" / "b") == tmp_path / "a" / "b"
        assert (tmp_path / "a" / "b").is_dir()
        assert jax.config.jax_compilation_cache_dir == str(tmp_path / "a" / "b")
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
        assert sk.keep_compiled() == tmp_path / "caches" / "shellkit"
    finally:
        jax.config.update("jax_compilation_cache_dir", before[0])
        jax.config.update("jax_persistent_cache_min_compile_time_secs", before[1])


@pytest.mark.parametrize("terminal", [True, False])
def test_a_word_is_said_on_terminals_only(terminal, monkeypatch):
    said = io.StringIO()
    monkeypatch.setattr(said, "isatty", lambda: terminal)
    monkeypatch.setattr(sys, "stderr", said)
    announce("a program")
    assert ("compiling a program" in said.getvalue()) == terminal


def test_optimisers_made_twice_are_one():
    schedule = lambda steps: optax.cosine_decay_schedule(0.1, steps)
    for make in (
        lambda: optax.adam(0.1),
        lambda: optax.chain(optax.clip(1.0), optax.sgd(0.2, momentum=0.9)),
        optax.lbfgs,
    ):
        assert first_like(make()) is first_like(make())
    for one, other in (
        (optax.adam(0.1), optax.adam(0.2)),
        (optax.adam(0.1), optax.adam(0.1, b1=0.8)),
        (optax.adam(0.1), optax.sgd(0.1)),
        (optax.sgd(1), optax.sgd(1.0)),
        (optax.adam(schedule(100)), optax.adam(schedule(200))),
        (optax.adam(jnp.asarray(0.1)), optax.adam(jnp.asarray(0.2))),
    ):
        assert first_like(one) is not first_like(other)


def test_functions_of_a_user_are_never_taken_for_each_other():
    """They may read globals, which have changed since."""

    def module(rate):
        names = {"RATE": rate}
        exec("def schedule(step):\n    return RATE / (1.0 + step.astype(float))", names)
        return names["schedule"]

    one, other = (first_like(optax.sgd(module(rate))) for rate in (0.1, 0.2))
    parameters = jnp.ones(2)
    update = lambda o: o.update(parameters, o.init(parameters), parameters)[0]
    assert jnp.allclose(update(one), -0.1) and jnp.allclose(update(other), -0.2)
