"""A whole job in a process of its own, several times: how long after its start it had come how far."""

import json
import os
import subprocess
import sys
import tempfile
import time
from typing import Any


def measure(mesh: str, job: str, steps: int, runs: int, warm: bool, adjoint: str | None = None) -> dict[str, Any]:
    """Start `benchmarks.jobs.<job>` so many times, with an empty cache of compiled programs or, `warm`, with that of a
    run before, which does not count."""
    arguments = [sys.executable, "-m", f"benchmarks.jobs.{job}", mesh, str(steps)]
    arguments += [] if adjoint is None else [adjoint]
    with tempfile.TemporaryDirectory() as folder:
        kept = {"JAX_COMPILATION_CACHE_DIR": folder, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.1"}
        settings = kept if warm else {}
        if warm:
            _run(arguments, settings)
        marks = [_run(arguments, settings) for _ in range(runs)]
    return {"marks": {name: [found[name] for found in marks] for name in marks[0]}}


def _run(arguments: list[str], settings: dict[str, str]) -> dict[str, float]:
    started = time.time()
    done = subprocess.run(arguments, env=os.environ | settings, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    return {line["mark"]: round(line["time"] - started, 3) for line in lines}
