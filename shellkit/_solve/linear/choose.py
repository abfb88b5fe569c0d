"""Which sparse solver to use: by name, by the environment variable SHELLKIT_SOLVER, or the best one installed."""

import importlib.util
import os

import jax

from ..._programs.renamed import formerly
from .base import AbstractSparseSolver
from .cholmod import Cholmod
from .iterative import ConjugateGradients
from .pardiso import Pardiso
from .superlu import SuperLU


# In order of preference: name, solver, the module it needs, and the package that has it.
_SOLVERS = (
    ("pardiso", Pardiso, "pardiso_mkl_jax", "pardiso-mkl-jax"),
    ("cholmod", Cholmod, "sparsax", "sparsax"),
    ("superlu", SuperLU, "scipy", "scipy"),
    ("cg", ConjugateGradients, "jax", "jax"),
)
_VARIABLE = "SHELLKIT_SOLVER"


def linear_solver(name: str) -> AbstractSparseSolver:
    """The solver of that name, with its default settings.

    **Arguments:**

    - `name`: `"pardiso"` (LDLᵀ with inertia; x86-64), `"cholmod"` (Cholesky; positive definite matrices), `"superlu"`
        (LU with inertia, by SciPy from the host) or `"cg"` (conjugate gradients; no factorisation at all).

    **Returns:**

    The solver, for `SparseNewton(linear_solver=...)`.

    **Raises:**

    `ValueError` for another name; `ImportError`, with the command to install it, if the package is not there.
    """
    for known, solver, module, package in _SOLVERS:
        if known == name:
            if not _is_installed(module):
                raise ImportError(f"the solver {name!r} needs the package {package}: pip install {package}")
            return solver()
    names = ", ".join(repr(known) for known, *_ in _SOLVERS)
    raise ValueError(f"there is no solver {name!r}: choose one of {names}")


direct_solver = formerly("direct_solver", linear_solver)


def default_linear_solver() -> AbstractSparseSolver:
    """The solver named by the environment variable `SHELLKIT_SOLVER`; else the first of `"pardiso"`, `"cholmod"` and
    `"superlu"` that is installed; on a GPU, where those would move every matrix to the host and back, `"cg"`.
    """
    if name := os.environ.get(_VARIABLE):
        return linear_solver(name)
    if jax.default_backend() != "cpu":
        return linear_solver("cg")
    return linear_solver(next(name for name, there in installed_solvers().items() if there))


def installed_solvers() -> dict[str, bool]:
    """Whether each solver has the package that it needs, by name, in order of preference."""
    return {name: _is_installed(module) for name, _, module, _ in _SOLVERS}


def _is_installed(module: str) -> bool:
    return importlib.util.find_spec(module) is not None
