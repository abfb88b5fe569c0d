"""A child process: `python -m benchmarks.child REQUEST ANSWER` does what a JSON file asks and writes the figures into
another. It imports only the worker asked for, and so runs in a peer's interpreter as well."""

import importlib
import json
import os
import sys
from importlib import metadata
from pathlib import Path


_PACKAGES = ("jax", "jaxlib", "equinox", "optimistix", "lineax", "numpy", "pardiso-mkl-jax", "sparsax", "triangulax")


def _versions() -> dict[str, str]:
    found = {"python": sys.version.split()[0]}
    for name in _PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def main() -> None:
    request = json.loads(Path(sys.argv[1]).read_text())
    # Before JAX starts: its pool has as many threads as there are cores to run on.
    cores = sorted(os.sched_getaffinity(0))[: request["threads"]]
    os.sched_setaffinity(0, cores)
    worker = importlib.import_module(f"benchmarks.workers.{request['worker']}")
    figures = worker.measure(**request["arguments"])
    Path(sys.argv[2]).write_text(json.dumps(figures | {"versions": _versions()}))


if __name__ == "__main__":
    main()
