"""Energy, gradient and exact Hessian of a whole mesh: the kernels under every relaxation."""

import jax
import numpy as np

import shellkit as sk
from shellkit._energy import DiscreteEnergy

from ..measure import repeat


_ENERGIES = {
    "average": lambda: sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0),
    "tan": lambda: sk.NeoHookean(bulk=1.0, shear=1.0) + sk.Bending(1.0, 1.0, form="tan"),
    "free": lambda: sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0, directors="free"),
    "membrane": lambda: sk.StVenantKirchhoff(1.0, 1.0),
}


def _energy(energy: DiscreteEnergy, y: jax.Array):
    return energy(y)


def _gradient(energy: DiscreteEnergy, y: jax.Array):
    return energy.gradient(y)


def _hessian(energy: DiscreteEnergy, y: jax.Array):
    return energy.hessian(y).values


def _all(energy: DiscreteEnergy, y: jax.Array):
    return _energy(energy, y), _gradient(energy, y), _hessian(energy, y)


def measure(subdivisions: int, energy: str, runs: int) -> dict:
    """The kernels at a deformed sphere, each compiled on its own; `all` is the three in one call."""
    mesh = sk.meshes.icosphere(subdivisions)
    problem = sk.InverseProblem(mesh=mesh, thickness=0.1, energy=_ENERGIES[energy]())
    discrete = problem.discrete_energy()
    rest = problem.assembly.restrict(problem.assembly.join(mesh.vertices, None))
    y = rest + 0.01 * np.random.default_rng(0).standard_normal(rest.shape)
    kernels = {"energy": _energy, "gradient": _gradient, "hessian": _hessian, "all": _all}
    return {
        "n_vertices": mesh.n_vertices,
        "n_faces": mesh.n_faces,
        "kernels": {name: repeat(jax.jit(kernel), discrete, y, runs=runs) for name, kernel in kernels.items()},
    }
