"""What a benchmark ran on: the machine, the versions, and the commit. Needs nothing but Python."""

import os
import platform
import subprocess
import sys
from importlib import metadata
from pathlib import Path


ROOT = Path(__file__).parent.parent
_CODE = ("shellkit", "validation", "benchmarks", "examples/meshes", "pyproject.toml", ":!benchmarks/results")
_PACKAGES = ("shellkit", "jax", "jaxlib", "equinox", "optimistix", "lineax", "numpy", "pardiso-mkl-jax", "sparsax")


def describe() -> dict[str, str | int | float]:
    """Processor, cores, memory and system of this machine."""
    cpu = _lines("/proc/cpuinfo", "model name")
    memory = _lines("/proc/meminfo", "MemTotal")
    return {
        "cpu": cpu[0] if cpu else platform.processor(),
        "cores": len(os.sched_getaffinity(0)),
        "memory_gb": round(int(memory[0].split()[0]) / 1024**2, 1),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
    }


def available_gb() -> float:
    """The memory that is free now."""
    return int(_lines("/proc/meminfo", "MemAvailable")[0].split()[0]) / 1024**2


def versions() -> dict[str, str]:
    """Python's version, and those of the packages that this interpreter has."""
    found = {"python": sys.version.split()[0]}
    for name in (*_PACKAGES, "triangulax"):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def commit() -> str:
    """The commit that is checked out, with a `+` where the code differs from it; `"unknown"` outside a clone."""
    try:
        name, changed = _git("rev-parse", "--short", "HEAD"), _git("status", "--porcelain", "--", *_CODE)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return name + ("+" if changed else "")


def _git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()


def _lines(path: str, key: str) -> list[str]:
    return [line.partition(":")[2].strip() for line in Path(path).read_text().splitlines() if line.startswith(key)]
