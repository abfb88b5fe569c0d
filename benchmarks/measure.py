"""Time and memory of a compiled function, measured inside a child process. Needs nothing but JAX and Equinox, so that
it serves the interpreter of a peer as well."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax


class Stage:
    """Wall time and peak memory of a block of host code, for use in a `with` statement."""

    seconds: float
    megabytes: float

    def __enter__(self) -> "Stage":
        # Sets the peak back to what is in use now.
        Path("/proc/self/clear_refs").write_text("5")
        self._before = _status("VmRSS")
        self._start = time.perf_counter()
        return self

    def __exit__(self, *exception: object) -> None:
        self.seconds = time.perf_counter() - self._start
        self.megabytes = _status("VmHWM") - self._before


def profile(function: Callable, *arguments: Any, runs: int) -> tuple[Any, dict[str, Any]]:
    """Compile a function, run it once, and then some times more.

    The first run stands alone: it may hold work done once per process, such as a symbolic factorisation.

    **Returns:** what the function returned, and the record: seconds to compile, of the first run, and of each later one
    (wall and processor), and the memory that compiling and running added at their peaks, in MB.
    """
    with Stage() as compilation:
        compiled = eqx.filter_jit(function).lower(*arguments).compile()
    with Stage() as run:
        result, first = timed(compiled, *arguments, runs=1)
        _, later = timed(compiled, *arguments, runs=runs)
    record = {"compile_s": compilation.seconds, "first_s": first["run_s"][0], "first_cpu_s": first["run_cpu_s"][0]}
    return result, record | later | {"compile_mb": compilation.megabytes, "run_mb": run.megabytes}


def repeat(function: Callable, *arguments: Any, runs: int) -> dict[str, Any]:
    """Time a function that is compiled already, such as a short kernel under `jax.jit`: one run unseen, then `runs`."""
    timed(function, *arguments, runs=1)
    return timed(function, *arguments, runs=runs)[1]


def timed(function: Callable, *arguments: Any, runs: int) -> tuple[Any, dict[str, list[float]]]:
    """What a function returned in the last of so many runs, and the seconds of each, wall and processor."""
    result, walls, cpus = None, [], []
    for _ in range(runs):
        wall, cpu = time.perf_counter(), time.process_time()
        result = jax.block_until_ready(function(*arguments))
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    return result, {"run_s": walls, "run_cpu_s": cpus}


def _status(field: str) -> float:
    """A line of Linux's account of this process, in MB."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(float(line.split()[1]) / 1024 for line in lines if line.startswith(field + ":"))
