"""Materials beyond the isotropic quadratic one, against closed forms and against minimisations done elsewhere."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

import shellkit as sk


THICKNESS = 0.02
PATCH = sk.meshes.rectangle(1.0, 1.0, cells=(3, 3), diagonals="jittered", seed=3)
REST = sk.RestShape.of(PATCH, jnp.asarray(THICKNESS), "theta")


def density(term, map_, rest=REST, bent=None):
    """Energy an area of a patch under an affine map, and with the curvature form `bent` in the axes x and y."""
    data = term.element_data(PATCH, rest)
    edges = np.asarray(PATCH.vertices)[np.asarray(PATCH.faces)][:, :, :2]
    basis = np.stack([edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]], axis=-1)
    in_edges = lambda form: np.einsum("fia,ij,fjb->fab", basis, form, basis)
    split = lambda form: tuple(jnp.asarray(form[:, i, j]) for i, j in ((0, 0), (0, 1), (1, 1)))
    metric = split(in_edges(map_.T @ map_))
    curvature = None if bent is None else split(in_edges(bent))
    return float(jnp.sum(term.density(metric, curvature, data)))


def angles_of(direction):
    return sk.director_angles(PATCH, jnp.asarray(direction))


@pytest.mark.parametrize("stretch", [0.5, 1.001, 2.0])
def test_incompressible_balloon(stretch):
    """mu/2 (2 λ² + λ^-4 - 3) a volume under equal stretch, from λ1 λ2 λ3 = 1."""
    expected = THICKNESS * 0.7 / 2 * (2 * stretch**2 + stretch**-4 - 3)
    found = density(sk.IncompressibleNeoHookean(0.7), stretch * np.eye(2))
    assert np.isclose(found, expected, rtol=1e-10)


def test_incompressible_rubber_is_that_of_a_block():
    """The energy of a block of which the stretch across is minimised under a bulk modulus sent to infinity."""
    map_ = np.array([[1.3, 0.2], [0.0, 0.9]])
    squares = np.trace(map_.T @ map_)
    across = 1 / np.linalg.det(map_)
    assert np.isclose(
        density(sk.IncompressibleNeoHookean.from_young(2.1), map_),
        THICKNESS * 0.7 / 2 * (squares + across**2 - 3),
        rtol=1e-12,
    )


def test_incompressible_agrees_with_stvk_at_rest():
    problems = [
        sk.InverseProblem(mesh=PATCH, thickness=THICKNESS, energy=term)
        for term in (sk.IncompressibleNeoHookean.from_young(1.7), sk.StVenantKirchhoff.from_young(1.7, 0.5))
    ]
    a, b = (problem.hessian(PATCH.vertices).values for problem in problems)
    assert jnp.allclose(a, b, rtol=0, atol=1e-12 * jnp.abs(a).max())


@pytest.mark.parametrize("seed", range(6))
def test_tension_field_is_the_lowest_energy_of_wrinkles(seed):
    """Wrinkles take up any excess length: the minimum of StVK over metrics g + a aᵀ + b bᵀ, found by another route."""
    rng = np.random.default_rng(seed)
    map_ = np.eye(2) + 0.3 * rng.normal(size=(2, 2))
    alpha, beta = 0.8, 0.5

    def stvk(excess):
        strain = map_.T @ map_ + excess - np.eye(2)
        return alpha * np.trace(strain) ** 2 + 2 * beta * np.trace(strain @ strain)

    def of(x):
        root = x.reshape(2, 2)
        return stvk(root.T @ root)

    best = min(minimize(of, rng.normal(size=4), tol=1e-14, method="BFGS").fun for _ in range(4))
    found = density(sk.TensionField(alpha, beta), map_)
    assert np.isclose(found, THICKNESS / 4 * best, rtol=1e-6, atol=1e-12)


def test_tension_field_regimes():
    alpha, beta = 0.8, 0.5
    term, full = sk.TensionField(alpha, beta), sk.StVenantKirchhoff(alpha, beta)
    poisson = alpha / (alpha + 2 * beta)
    young = 4 * beta * (1 + poisson)
    taut = np.diag([1.1, 1.05])
    assert np.isclose(density(term, taut), density(full, taut), rtol=1e-13)
    # Uniaxial tension: E eps² / 2 with Green's strain, whatever the width.
    strain = (1.2**2 - 1) / 2
    for width in (0.3, 0.8):
        wrinkled = np.diag([1.2, width])
        assert np.isclose(density(term, wrinkled), THICKNESS * young * strain**2 / 2, rtol=1e-12)
    assert density(term, np.diag([0.9, 0.99])) == 0.0
    assert np.isclose(
        density(sk.TensionField(alpha, beta, residual=0.25), np.diag([0.9, 0.99])),
        0.25 * density(full, np.diag([0.9, 0.99])),
    )


def test_tension_field_has_continuous_forces():
    """Across both boundaries of the regimes and at the unstrained point, where the principal strains are equal."""
    term = sk.TensionField(0.8, 0.5)
    energy = sk.InverseProblem(mesh=PATCH, thickness=THICKNESS, energy=term)
    force = jax.jit(jax.grad(energy.total_energy))
    at = lambda x, y: force(PATCH.vertices * jnp.array([x, y, 1.0]))
    natural = float(np.sqrt(1 - 0.8 / 1.8 * (1.1**2 - 1)))
    scale = float(jnp.abs(at(1.1, 1.1)).max())
    for x, y, dx, dy in ((1.1, natural, 0, 1), (1.0, 0.7, 1, 0), (1.0, 1.0, 1, 1), (1.0, 1.0, 1, -1)):
        ahead, behind = at(x + 1e-7 * dx, y + 1e-7 * dy), at(x - 1e-7 * dx, y - 1e-7 * dy)
        assert jnp.abs(ahead - behind).max() < 1e-5 * scale
    curvature = jax.jit(jax.hessian(lambda s: energy.total_energy(s * PATCH.vertices)))
    assert jnp.isfinite(curvature(1.0)) and jnp.isfinite(curvature(1.1))


@pytest.mark.parametrize("stretching", [True, False])
def test_orthotropic_is_isotropic_for_equal_moduli(stretching):
    young, poisson = 1.7, 0.3
    constants = dict(along=young, across=young, poisson=poisson, shear=young / (2 * (1 + poisson)))
    map_, bent = np.array([[1.2, 0.3], [-0.1, 0.8]]), np.array([[1.0, 0.3], [0.3, -0.5]])
    if stretching:
        pair = sk.OrthotropicStretching(0.7, **constants), sk.StVenantKirchhoff.from_young(young, poisson)
    else:
        pair = sk.OrthotropicBending(0.7, **constants), sk.Bending.from_young(young, poisson)
    a, b = (density(term, map_, bent=None if stretching else bent) for term in pair)
    assert np.isclose(a, b, rtol=1e-12)


def test_orthotropic_engineering_constants():
    """Pulled along the grain with the width free: E1 ε²/2 and the width -ν12 ε; across it: E2; sheared: 2 G ε12²."""
    e1, e2, poisson, shear = 3.0, 1.1, 0.35, 0.4
    direction = np.array([np.cos(0.6), np.sin(0.6), 0.0])
    term = sk.OrthotropicStretching(angles_of(direction), e1, e2, poisson, shear)
    turn = np.array([[np.cos(0.6), -np.sin(0.6)], [np.sin(0.6), np.cos(0.6)]])

    def energy(strain):
        values, vectors = np.linalg.eigh(np.eye(2) + 2 * turn @ strain @ turn.T)
        return density(term, vectors @ np.diag(np.sqrt(values)) @ vectors.T) / THICKNESS

    strain = 0.04
    assert np.isclose(energy(np.diag([strain, -poisson * strain])), e1 * strain**2 / 2, rtol=1e-12)
    assert np.isclose(energy(np.diag([-poisson * e2 / e1 * strain, strain])), e2 * strain**2 / 2, rtol=1e-12)
    assert np.isclose(energy(strain * np.array([[0, 1], [1, 0]])), 2 * shear * strain**2, rtol=1e-12)


def test_grain_is_carried_along_by_growth():
    """A sheet that grew by a shear stretches along the image of its grain as the sheet at rest does along the grain."""
    growth = np.array([[1.2, 0.5], [0.0, 0.9]])
    edges = np.asarray(PATCH.vertices)[np.asarray(PATCH.faces)][:, :, :2]
    basis = np.stack([edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]], axis=-1)
    grown = np.einsum("fia,ij,fjb->fab", basis, growth.T @ growth, basis)
    rest = sk.RestShape(jnp.asarray(grown), REST.curvature, REST.thickness)
    term = sk.OrthotropicStretching(angles_of([1.0, 0.0, 0.0]), 3.0, 1.1, 0.35, 0.4)
    # The grain is x before and after this growth, so a further stretch along x costs E1/2 an area of the grown sheet.
    further = np.diag([np.sqrt(1 + 0.08), np.sqrt(1 - 0.35 * 0.08)])
    expected = THICKNESS * np.linalg.det(growth) * 3.0 * 0.04**2 / 2
    assert np.isclose(density(term, further @ growth, rest=rest), expected, rtol=1e-10)


def test_laminate_energy_of_equal_plies_is_that_of_one_material():
    constants = dict(along=3.0, across=1.1, poisson=0.35, shear=0.4)
    plies = [sk.Ply(0.3, **constants, thickness=t) for t in (0.2, 1.0, 0.5)]
    map_, bent = np.array([[1.2, 0.3], [-0.1, 0.8]]), np.array([[1.0, 0.3], [0.3, -0.5]])
    whole = density(sk.OrthotropicStretching(0.3, **constants), map_)
    whole += density(sk.OrthotropicBending(0.3, **constants), map_, bent=bent)
    assert np.isclose(density(sk.LaminateEnergy(plies), map_, bent=bent), whole, rtol=1e-12)


def test_laminate_energy_is_the_integral_through_the_thickness():
    """By quadrature of the energy of thin slices, each of which is stretched by g + 2 z b."""
    first = dict(along=3.0, across=1.1, poisson=0.35, shear=0.4)
    second = dict(along=0.8, across=2.0, poisson=0.1, shear=0.7)
    laminate = sk.LaminateEnergy([sk.Ply(0.3, **first, thickness=1.0), sk.Ply(1.1, **second, thickness=3.0)])
    map_, bent = np.array([[1.1, 0.1], [-0.1, 0.9]]), np.array([[6.0, 2.0], [2.0, -5.0]])
    total = 0.0
    nodes, weights = np.polynomial.legendre.leggauss(3)
    for low, high, angle, constants in ((-0.5, -0.25, 0.3, first), (-0.25, 0.5, 1.1, second)):
        for node, weight in zip(nodes, weights, strict=True):
            z = THICKNESS * (0.5 * (low + high) + 0.5 * (high - low) * node)
            slice_ = sk.OrthotropicStretching(angle, **constants)
            values, vectors = np.linalg.eigh(map_.T @ map_ + 2 * z * bent)
            root = vectors @ np.diag(np.sqrt(values)) @ vectors.T
            total += 0.5 * (high - low) * weight * density(slice_, root)
    assert np.isclose(density(laminate, map_, bent=bent), total, rtol=1e-10)


def test_cross_ply_strip_couples_pull_and_curl():
    """Two plies at right angles: free bending under a pull is -D⁻¹ B e; none for the symmetric stack of three."""
    grain = [angles_of([1.0, 0.0, 0.0]), angles_of([0.0, 1.0, 0.0])]
    ply = lambda which, t=1.0: sk.Ply(grain[which], along=10.0, across=1.0, poisson=0.2, shear=0.5, thickness=t)
    pulled = np.diag([1.01, 1.0])
    step = 1e-3
    for plies, curls in (([ply(0), ply(1)], True), ([ply(0), ply(1, 2.0), ply(0)], False)):
        term = sk.LaminateEnergy(plies)
        ahead, behind = (density(term, pulled, bent=s * step * np.diag([1.0, 0.0])) for s in (1, -1))
        slope = (ahead - behind) / (2 * step)
        h, strain = THICKNESS, 1.01**2 - 1
        coupling = (10.0 - 1.0) / (1 - 0.2**2 / 10) * -(h**2) / 8
        assert np.isclose(slope, 0.5 * coupling * strain if curls else 0.0, rtol=1e-8, atol=1e-12)


def test_fields_of_moduli_and_thickness():
    """Everything one number per face is the sum over faces of everything one number."""
    rng = np.random.default_rng(0)
    some = jnp.asarray(rng.uniform(0.5, 2.0, PATCH.n_faces))
    problem = sk.InverseProblem(
        mesh=PATCH,
        thickness=0.1 * some,
        energy=sk.TensionField(some, some)
        + sk.IncompressibleNeoHookean(some)
        + sk.LaminateEnergy([sk.Ply(some, some, some, 0.2, some, thickness=some), sk.Ply.isotropic(some, 0.3)])
        + sk.OrthotropicStretching(some, some, some, 0.2 * jnp.ones_like(some), some),
    )
    assert np.isfinite(float(problem.total_energy(1.1 * PATCH.vertices)))
    double = sk.DihedralBending(jnp.full(PATCH.n_edges, 2.0))
    bent = PATCH.vertices.at[5, 2].add(0.2)
    one, two = (
        float(sk.InverseProblem(mesh=PATCH, thickness=0.1, energy=e).total_energy(bent))
        for e in (sk.DihedralBending(1.0), double)
    )
    assert np.isclose(two, 2 * one, rtol=1e-13)


@pytest.mark.parametrize(
    "energy, words",
    [
        (sk.OrthotropicStretching(0.0, 1.0, 4.0, 0.6, 1.0), "poisson² · across"),
        (sk.OrthotropicBending(jnp.zeros(3), 1.0, 1.0, 0.3, 1.0), r"angle has shape \(3,\)"),
        (sk.OrthotropicStretching(0.0, -1.0, 1.0, 0.3, 1.0), "must be positive"),
        (sk.LaminateEnergy([sk.Ply.isotropic(1.0, 0.3, thickness=0.0)]), "ply 0: thickness"),
        (sk.TensionField(jnp.ones(2), 1.0), r"alpha has shape \(2,\)"),
        (sk.IncompressibleNeoHookean(jnp.ones(2)), r"shear has shape \(2,\)"),
        (sk.DihedralBending(jnp.ones(2)), r"stiffness has shape \(2,\)"),
    ],
)
def test_wrong_materials_are_refused(energy, words):
    with pytest.raises(ValueError, match=words):
        sk.InverseProblem(mesh=PATCH, thickness=0.1, energy=energy)


def test_a_laminate_of_nothing_is_refused():
    with pytest.raises(ValueError, match="no plies"):
        sk.LaminateEnergy([])
    with pytest.raises(ValueError, match="'free'"):
        sk.OrthotropicBending(0.0, 1.0, 1.0, 0.3, 1.0, directors="loose")
