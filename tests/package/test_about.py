"""The report on an installation says what is so, and says it also where something is broken."""

import importlib.util
import os
import platform
import subprocess
import sys
from importlib import metadata

import jax
import numpy as np
import pytest

import shellkit as sk


def test_versions_are_those_installed():
    versions = sk.about().versions
    assert versions["shellkit"] == sk.__version__
    assert versions["Python"] == platform.python_version()
    assert versions["numpy"] == np.__version__ and versions["jax"] == jax.__version__
    assert {"jaxlib", "equinox", "optimistix", "lineax", "optax"} < set(versions)


def test_a_package_that_is_not_there(monkeypatch):
    def version(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "version", version)
    assert sk.about().versions["optax"] == "not installed"


def test_solver_is_the_one_that_would_be_taken(monkeypatch):
    monkeypatch.delenv("SHELLKIT_SOLVER", raising=False)
    monkeypatch.setattr(jax, "default_backend", lambda: "cpu")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "pardiso_mkl_jax" else name)
    report = sk.about()
    assert report.solver == "Cholmod"
    assert report.solvers == {"pardiso": False, "cholmod": True, "superlu": True, "cg": True}
    monkeypatch.setenv("SHELLKIT_SOLVER", "superlu")
    assert sk.about().solver == "SuperLU"


@pytest.mark.parametrize("chosen", ["umfpack", "pardiso"])
def test_a_solver_that_cannot_be_had_is_reported(chosen, monkeypatch):
    monkeypatch.setenv("SHELLKIT_SOLVER", chosen)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "pardiso_mkl_jax" else name)
    assert repr(chosen) in sk.about().solver and "Error: " in sk.about().solver


def test_a_driver_that_fails_is_reported(monkeypatch):
    def devices():
        raise RuntimeError("no such device")

    monkeypatch.setattr(jax, "devices", devices)
    assert sk.about().devices == "RuntimeError: no such device"


def test_settings_of_jax(tmp_path):
    report = sk.about()
    assert report.x64 and report.cache is None  # as tests/conftest.py sets them
    program = (
        f"import shellkit as sk; sk.keep_compiled({str(tmp_path)!r}); report = sk.about();"
        "print(report.cache, report.x64, report.devices)"
    )
    environment = os.environ | {"JAX_PLATFORMS": "cpu"}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=environment)
    assert (done.stdout.strip(), done.returncode) == (f"{tmp_path} False cpu: cpu", 0), done.stderr


def test_a_line_for_each_finding():
    report = sk.about()
    lines = str(report).splitlines()
    assert len(lines) == len(report.versions) + 8
    for name, value in report.versions.items():
        assert any(line.split() == [name, *value.split()] for line in lines)
    assert any(line.startswith("CPUs ") and line.endswith(f" of {os.cpu_count()}") for line in lines)
    assert f"{report.system}" in str(report) and platform.machine() in report.system
