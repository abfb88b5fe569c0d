"""Which other shapes a shell can take: equilibria found by relaxing it from perturbed starts.

What is found depends on the starts; each shape comes with its energy and how many of them led there."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._equilibrium import RESULTS, Equilibrium
from .._geometry.surface import edge_lengths
from .._problem.problem import InverseProblem


class DistinctEquilibria(eqx.Module):
    """Equilibria of one problem that differ in shape, in the order of their energies; printing it shows a table."""

    equilibria: tuple[Equilibrium, ...]
    """The lowest energy first."""
    found: tuple[int, ...] = eqx.field(static=True)
    """From how many of the starts each was reached."""
    failures: tuple[str, ...] = eqx.field(static=True)
    """Why relaxations from other starts failed."""

    def __str__(self) -> str:
        lines = ["      energy  found  "]
        for at, count in zip(self.equilibria, self.found, strict=True):
            lines.append(f"{float(at.energy):12.5e}  {count:5d}  {'stable' if at.stable else 'unstable'}")
        return "\n".join([*lines, *(f"failed: {reason}" for reason in self.failures)])


def distinct_equilibria(
    problem: InverseProblem, starts: int = 8, noise: float = 0.5, seed: int = 0, tolerance: float = 1e-4
) -> DistinctEquilibria:
    """Relax a shell from perturbed starts, and tell how many shapes it can take: the flat sheet that bends to one side
    or the other, the shell that is stable inside out.

    What is found depends on the starts: shapes that are not found may exist all the same. On the host.

    **Arguments:**

    - `problem`: the shell.
    - `starts`: how many perturbed ones there are, beside the surface at rest itself.
    - `noise`: the standard deviation of the displacement of a vertex, in edges.
    - `seed`: of the random numbers.
    - `tolerance`: how far, in edges, two shapes may be apart to count as one. They are brought together by a rigid
        motion first where all six are free.

    **Returns:**

    The [`shellkit.DistinctEquilibria`][].
    """
    edge = float(jnp.mean(edge_lengths(problem.mesh.vertices, problem.mesh)))
    rng = np.random.default_rng(seed)
    rest = problem.unrelaxed()
    shapes, counts, failures = [], [], []
    for number in range(starts + 1):
        shift = rng.normal(size=rest.vertices.shape) * noise * edge if number else 0.0
        equilibrium = problem(eqx.tree_at(lambda e: e.vertices, rest, rest.vertices + shift))
        if not equilibrium.converged:
            failures.append(RESULTS[equilibrium.result])
            continue
        # Free shells come back in the pose nearest to the surface at rest, all alike.
        same = [
            k
            for k, other in enumerate(shapes)
            if float(jnp.max(jnp.abs(other.vertices - equilibrium.vertices))) < tolerance * edge
        ]
        if same:
            counts[same[0]] += 1
        else:
            shapes.append(equilibrium)
            counts.append(1)
    order = sorted(range(len(shapes)), key=lambda k: float(shapes[k].energy))
    return DistinctEquilibria(tuple(shapes[k] for k in order), tuple(counts[k] for k in order), tuple(failures))
