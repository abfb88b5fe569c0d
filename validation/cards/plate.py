"""Card 7: a simply supported square plate that is loaded, vibrates and buckles."""

from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np

import shellkit as sk

from ..figures import Figure, timed
from ..linear import factorised, solve, stiffness
from ..meshes import KINDS, Kind, sheet


TITLE = "Simply supported plate"
PROBLEM = (
    "A unit square, h = 0.01, E = 1, ν = 0.3, its boundary held normal to the plane: deflection of the middle under an "
    "even load q, 0.00406235266 qL⁴/D; first eigenvalue with unit mass an area, 4π⁴D/L⁴; strain at which it buckles "
    "under uniaxial stress, π²h²/3(1 − ν²)L²."
)
THICKNESS, POISSON = 0.01, 0.3
_D = THICKNESS**3 / 12 / (1 - POISSON**2)
EXACT = {
    "deflection": 0.00406235266 / _D,
    "first eigenvalue": 4 * np.pi**4 * _D,
    "buckling strain": np.pi**2 * THICKNESS**2 / 3 / (1 - POISSON**2),
}
SIZES = {1: (6, 12), 2: (8, 16, 24), 3: (12, 24, 48), 4: (12, 24, 48, 96)}


def plate(kind: Kind, cells: int, directors: str = "free", form: str = "sin") -> sk.InverseProblem:
    """The plate under an even load; an even number of cells has a vertex in the middle."""
    mesh = sheet(kind, (cells, cells))
    if kind == "J":
        # The middle is where the deflection is read: put the vertex nearest to it there.
        middle = jnp.argmin(jnp.linalg.norm(mesh.vertices[:, :2] - 0.5, axis=1))
        mesh = mesh.with_vertices(mesh.vertices.at[middle, :2].set(0.5))
    return sk.InverseProblem(
        mesh=mesh,
        thickness=THICKNESS,
        energy=sk.StVenantKirchhoff.from_young(1.0, POISSON)
        + sk.Bending.from_young(1.0, POISSON, directors=directors, form=form)
        + sk.SurfaceLoad(jnp.array([0.0, 0.0, 1.0])),
        supports=sk.Sliding(mesh.boundary_vertices, normal="z"),
    )


def answers(problem: sk.InverseProblem) -> dict[str, float]:
    """The three figures, from the stiffness out of the plane at rest and under compression."""
    from scipy.sparse import csc_array, diags_array
    from scipy.sparse.linalg import LinearOperator, eigsh

    mesh, free = problem.mesh, np.asarray(problem.assembly.dofs.free)
    out = np.flatnonzero((free % 3 == 2) | (free >= 3 * mesh.n_vertices))
    heights = free[out] < 3 * mesh.n_vertices
    relaxed, gradient = stiffness(problem)
    strain = EXACT["buckling strain"]
    squeezed, _ = stiffness(problem, mesh.vertices * jnp.array([1 - strain, 1 + POISSON * strain, 1.0]))
    matrix, loss = (csc_array(m[out][:, out]) for m in (relaxed, relaxed - squeezed))

    deflection = solve(matrix, -gradient[out])
    middle = np.argmin(np.linalg.norm(np.asarray(mesh.vertices)[:, :2] - 0.5, axis=1))
    mass = np.zeros(len(out))
    mass[heights] = np.asarray(sk.vertex_areas(mesh.vertices, mesh))[free[out][heights] // 3]
    inverse = factorised(matrix)
    operator = LinearOperator(matrix.shape, matvec=inverse.solve, dtype=float)
    start = np.where(heights, 1.0, 0.0)
    vibration = eigsh(diags_array(mass), k=1, M=matrix, Minv=operator, which="LA", v0=start, return_eigenvectors=False)
    buckling = eigsh(loss / strain, k=1, M=matrix, Minv=operator, which="LA", v0=start, return_eigenvectors=False)
    return {
        "deflection": float(deflection[np.flatnonzero(free[out] == 3 * middle + 2)[0]]),
        "first eigenvalue": 1 / float(vibration[0]),
        "buckling strain": 1 / float(buckling[0]),
    }


def measure(level: int) -> Iterator[Figure]:
    """Free directors and averaged normals on all kinds of meshes."""
    for kind in KINDS:
        for directors in ("free", "average"):
            for cells in SIZES[level]:
                problem = plate(kind, cells, directors)
                found, seconds = timed(lambda problem=problem: answers(problem))
                for name, exact in EXACT.items():
                    yield Figure(name, f"{directors}, {kind}", cells, exact, found[name], seconds)
