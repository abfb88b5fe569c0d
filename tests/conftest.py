"""What every test stands on: float64, shapes checked at every call, and no trace of one run in the next."""

import os

import pytest


if "PYTEST_XDIST_WORKER" in os.environ:
    # Workers share the cores already; threads of the solver that spin for each other would only slow them down.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
# Nearly all of a test's time is compilation, of programs that run once on small meshes.
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true")

import jax
import jaxtyping


jax.config.update("jax_enable_x64", True)
# A mix of widths or kinds that was not written out is an error.
jax.config.update("jax_numpy_dtype_promotion", "strict")
# Counts of compilations must not depend on what an earlier run left on disk.
jax.config.update("jax_enable_compilation_cache", False)
# From here on, importing shellkit checks each annotated shape and type when a function is traced.
jaxtyping.install_import_hook("shellkit", "beartype.beartype")


@pytest.fixture(autouse=True, scope="module")
def forget_compiled_programs():
    """Compiled programs are kept for one file only: a whole run's would take gigabytes."""
    yield
    jax.clear_caches()
