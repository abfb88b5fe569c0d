"""A child process: `python -m benchmarks.child REQUEST ANSWER` does what a JSON file asks and writes the figures into
another. It imports only the module asked for, and so runs in a peer's interpreter as well."""

import importlib
import json
import os
import sys
from pathlib import Path

from .conditions import versions


def main() -> None:
    request = json.loads(Path(sys.argv[1]).read_text())
    # Before JAX starts: its pool has as many threads as there are cores to run on.
    cores = sorted(os.sched_getaffinity(0))[: request["threads"]]
    os.sched_setaffinity(0, cores)
    measure = getattr(importlib.import_module(f"benchmarks.{request['module']}"), request["function"])
    figures = measure(**request["arguments"])
    Path(sys.argv[2]).write_text(json.dumps(figures | {"versions": versions()}))


if __name__ == "__main__":
    main()
