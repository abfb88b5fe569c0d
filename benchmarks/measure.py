"""Time and memory of a compiled function, measured inside a child process. Needs nothing but JAX and Equinox, so that
it serves the interpreter of a peer as well."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax


def profile(function: Callable, *arguments: Any, runs: int) -> tuple[Any, dict[str, Any]]:
    """Compile a function, run it once, and then some times more.

    The first run stands alone: it may hold work done once per process, such as a symbolic factorisation.

    **Returns:** what the function returned, and the record: seconds to compile, of the first run, and of each later one
    (wall and processor), and the memory that compiling and running added at their peaks, in MB.
    """
    before = _rewind()
    start = time.perf_counter()
    compiled = eqx.filter_jit(function).lower(*arguments).compile()
    compile_s = time.perf_counter() - start
    compile_mb = _status("VmHWM") - before

    before = _rewind()
    result, first_s, first_cpu_s = _timed(compiled, arguments)
    samples = [_timed(compiled, arguments)[1:] for _ in range(runs)]
    record = {
        "compile_s": compile_s,
        "first_s": first_s,
        "first_cpu_s": first_cpu_s,
        "run_s": [wall for wall, _ in samples],
        "run_cpu_s": [cpu for _, cpu in samples],
        "compile_mb": compile_mb,
        "run_mb": _status("VmHWM") - before,
    }
    return result, record


def repeat(function: Callable, *arguments: Any, runs: int) -> dict[str, Any]:
    """Time a function that is compiled already, such as a short kernel under `jax.jit`: one run unseen, then `runs`."""
    _timed(function, arguments)
    samples = [_timed(function, arguments)[1:] for _ in range(runs)]
    return {"run_s": [wall for wall, _ in samples], "run_cpu_s": [cpu for _, cpu in samples]}


class Stage:
    """Wall time and peak memory of a block of host code, for use in a `with` statement."""

    seconds: float
    megabytes: float

    def __enter__(self) -> "Stage":
        self._before = _rewind()
        self._start = time.perf_counter()
        return self

    def __exit__(self, *exception: object) -> None:
        self.seconds = time.perf_counter() - self._start
        self.megabytes = _status("VmHWM") - self._before


def peak_memory() -> float:
    """The largest memory of this process since the last measurement began, in MB."""
    return _status("VmHWM")


def resident() -> float:
    """The memory of this process now, in MB."""
    return _status("VmRSS")


def _timed(function: Callable, arguments: tuple) -> tuple[Any, float, float]:
    wall, cpu = time.perf_counter(), time.process_time()
    result = jax.block_until_ready(function(*arguments))
    return result, time.perf_counter() - wall, time.process_time() - cpu


def _rewind() -> float:
    """Set the peak of memory back to what is in use now, and return that."""
    Path("/proc/self/clear_refs").write_text("5")
    return resident()


def _status(field: str) -> float:
    """A line of Linux's account of this process, in MB."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(float(line.split()[1]) / 1024 for line in lines if line.startswith(field + ":"))
