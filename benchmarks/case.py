"""One measurement: what is run in which interpreter, and how it is run there."""

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from . import conditions, meshes


Row = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """A call of a function of `benchmarks.<module>` with arguments, in a process of its own.

    An argument called `mesh` is the name of a mesh, and reaches the function as the path of its file.
    """

    label: str
    module: str
    arguments: dict[str, Any] = field(default_factory=dict)
    function: str = "measure"
    of_peer: bool = False
    threads: int | None = None  # None: what the command line says
    needs_gb: float = 1.0
    limit_s: float = 900.0
    platform: str = "cpu"  # what JAX calls it
    settings: dict[str, str] = field(default_factory=dict)  # of the environment


def run(case: Case, threads: int, peer_python: str | None) -> Row:
    """Run a case and return its record: label, arguments (`"case"`), conditions, and the figures, or under `"skipped"`
    or `"failed"` why there are none."""
    row: Row = {
        "label": case.label,
        "case": case.arguments,
        "threads": case.threads or threads,
        "platform": case.platform,
        "machine": conditions.describe(),
        "commit": conditions.commit(),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "load": round(os.getloadavg()[0], 2),
    }
    if case.of_peer and peer_python is None:
        return row | {"skipped": "no interpreter with triangulax was named: use --peer-python"}
    if case.platform == "cuda" and not Path("/dev/nvidia0").exists():
        return row | {"skipped": "there is no GPU here"}
    free = conditions.available_gb()
    if free < case.needs_gb:
        return row | {"skipped": f"needs about {case.needs_gb:.0f} GB of memory, and {free:.0f} GB are free"}
    arguments = dict(case.arguments)
    if "mesh" in arguments:
        arguments["mesh"] = str(meshes.file(arguments["mesh"]))
    python = peer_python if case.of_peer else sys.executable
    assert python is not None
    return row | _call(python, case, arguments, row["threads"])


def _call(python: str, case: Case, arguments: dict[str, Any], threads: int) -> Row:
    asked = {"module": case.module, "function": case.function, "arguments": arguments, "threads": threads}
    settings = {
        "JAX_PLATFORMS": "cpu" if case.platform == "cpu" else f"{case.platform},cpu",
        "JAX_ENABLE_X64": "1",
        "JAX_TRACEBACK_FILTERING": "off",  # the last line is then the error
    }
    with tempfile.TemporaryDirectory() as folder:
        request, answer = Path(folder, "request.json"), Path(folder, "answer.json")
        request.write_text(json.dumps(asked))
        try:
            finished = subprocess.run(
                [python, "-m", "benchmarks.child", str(request), str(answer)],
                cwd=conditions.ROOT,
                env=os.environ | settings | case.settings,
                capture_output=True,
                text=True,
                timeout=case.limit_s,
            )
        except subprocess.TimeoutExpired:
            return {"failed": f"took more than {case.limit_s:.0f} s"}
        if finished.returncode or not answer.exists():
            reason = finished.stderr.strip().splitlines()[-1:] or [f"ended with code {finished.returncode}"]
            print(finished.stderr, file=sys.stderr)
            return {"failed": reason[0][:300]}
        return json.loads(answer.read_text())
