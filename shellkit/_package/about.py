"""A report on this installation, for whoever has to find out why something works on one machine and not on another."""

import os
import platform
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata

import jax

from .._solve.linear.choose import default_linear_solver, installed_solvers
from .distribution import __version__


_DEPENDENCIES = ("jax", "jaxlib", "equinox", "optimistix", "lineax", "optax", "numpy", "scipy")


@dataclass(frozen=True)
class About:
    """What [`shellkit.about`][] found; printed as one line for each."""

    versions: dict[str, str]
    solver: str
    solvers: dict[str, bool]
    devices: str
    x64: bool
    cache: str | None
    system: str
    cpus: str

    def __repr__(self) -> str:
        rows = self.versions | {
            "linear solver": self.solver,
            "solvers installed": ", ".join(name for name, there in self.solvers.items() if there),
            "solvers absent": ", ".join(name for name, there in self.solvers.items() if not there) or "none",
            "devices": self.devices,
            "double precision": "on" if self.x64 else "off",
            "persistent cache": self.cache or "off",
            "system": self.system,
            "CPUs": self.cpus,
        }
        width = max(map(len, rows))
        return "\n".join(f"{name:<{width}}  {value}" for name, value in rows.items())


def about() -> About:
    """What a bug report needs to say about the machine and the packages on it. In a terminal:
    `python -c "import shellkit as sk; print(sk.about())"`.

    It starts JAX, so that settings which must be made before, such as `JAX_PLATFORMS`, come first. Nothing is compiled.

    **Returns:**

    A report to print, with the fields `versions` (of Python, shellkit and the packages that it stands on, by name),
    `solver` (the linear solver that [`shellkit.SparseNewton`][] would take), `solvers` (by name, whether each is
    installed), `devices`, `x64` (whether JAX computes in double precision), `cache` (the folder of
    [`shellkit.keep_compiled`][] or of JAX's own setting, `None` if nothing is kept), `system` and `cpus`. What cannot
    be found out, as with a broken driver, has the error in its place.
    """
    return About(
        versions={"shellkit": __version__, "Python": platform.python_version()}
        | {name: _version(name) for name in _DEPENDENCIES},
        solver=_or_error(lambda: type(default_linear_solver()).__name__),
        solvers=installed_solvers(),
        devices=_or_error(lambda: ", ".join(f"{device.platform}: {device.device_kind}" for device in jax.devices())),
        x64=bool(jax.config.read("jax_enable_x64")),
        cache=_cache(),
        system=f"{platform.platform()}, {platform.machine()}",
        cpus=_cpus(),
    )


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"


def _or_error(found: Callable[[], str]) -> str:
    try:
        return found()
    except (ImportError, RuntimeError, ValueError) as error:
        return f"{type(error).__name__}: {error}"


def _cache() -> str | None:
    settings = jax.config.values
    folder = settings["jax_compilation_cache_dir"]
    return str(folder) if folder and settings["jax_enable_compilation_cache"] else None


def _cpus() -> str:
    """How many this process may use, of how many the machine has."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return f"{usable} of {os.cpu_count()}"
