"""What a benchmark ran on."""

import os
import platform
from pathlib import Path


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


def _lines(path: str, key: str) -> list[str]:
    return [line.partition(":")[2].strip() for line in Path(path).read_text().splitlines() if line.startswith(key)]
