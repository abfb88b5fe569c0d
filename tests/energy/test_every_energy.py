"""Every energy × every property: derivatives against automatic differentiation, invariance, rest state, weights."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk
from shellkit._energy import Assembly, DiscreteEnergy, FormEnergy, Unknowns
from shellkit._relaxation.minimise import Feasible


class Springs(sk.EnergyTerm):
    """A user's own term."""

    stiffness: jax.Array

    def stencil(self, mesh):
        return mesh.edges

    def element_data(self, mesh, rest):
        a, b = mesh.vertices[mesh.edges[:, 0]], mesh.vertices[mesh.edges[:, 1]]
        return jnp.linalg.norm(a - b, axis=-1)

    def element_energy(self, x, rest_length):
        return 0.5 * self.stiffness * (jnp.linalg.norm(x[0] - x[1]) - rest_length) ** 2


ENERGIES = {
    "stvk": sk.StVenantKirchhoff(alpha=1.0, beta=0.7),
    "neo-hookean": sk.NeoHookean(bulk=1.0, shear=1.3),
    "bending-sin": sk.Bending(alpha=1.0, beta=0.7),
    "bending-tan": sk.Bending(alpha=1.0, beta=0.7, form="tan"),
    "bending-free": sk.Bending(alpha=1.0, beta=0.7, form="theta", directors="free"),
    # Terms that differ in their density alone are compiled together.
    "membranes": sk.IncompressibleNeoHookean(shear=1.3) + sk.TensionField(alpha=1.0, beta=0.7, residual=0.01),
    "grain": sk.OrthotropicStretching(0.4, along=3.0, across=1.0, poisson=0.4, shear=0.6)
    + sk.OrthotropicBending(0.4, along=3.0, across=1.0, poisson=0.4, shear=0.6)
    + sk.LaminateEnergy(
        [sk.Ply(0.4, along=3.0, across=1.0, poisson=0.4, shear=0.6, thickness=2.0), sk.Ply.isotropic(2.0, 0.3)]
    ),
    "dihedral": sk.DihedralBending(stiffness=0.3),
    "springs": Springs(jnp.asarray(2.0)),
    "sum": sk.NeoHookean(bulk=1.0, shear=1.3)
    + 3.0 * sk.Bending(alpha=1.0, beta=0.7, form="tan", directors="free")
    + 0.1 * Springs(jnp.asarray(2.0)),
}
MESHES = {
    "closed": sk.meshes.icosphere(subdivisions=1),
    "open": sk.meshes.rectangle(1.0, 1.0, cells=(3, 3), diagonals="jittered"),
}


def build(energy, mesh, thickness=0.1):
    forms = [t.form for _, t in energy.weighted_terms() if isinstance(t, FormEnergy) and t.form]
    rest = sk.RestShape.of(mesh, jnp.asarray(thickness), forms[0] if forms else None)
    assembly = Assembly.of(energy, mesh)
    return DiscreteEnergy(energy, mesh, rest, assembly, jnp.zeros(assembly.dofs.size))


def shape(energy, mesh, size=0.05, seed=0):
    y = energy.assembly.dofs.pack(Unknowns(mesh.vertices))
    return y + size * np.random.default_rng(seed).normal(size=y.shape)


@pytest.fixture(params=sorted(MESHES))
def mesh(request):
    return MESHES[request.param]


@pytest.mark.parametrize("name", sorted(ENERGIES))
def test_derivatives_agree_with_automatic_differentiation(name, mesh):
    energy = build(ENERGIES[name], mesh)
    y = shape(energy, mesh)
    value = eqx.filter_jit(lambda e, y: e(y))
    gradient = jax.jit(jax.grad(lambda y: value(energy, y)))(y)
    assert jnp.allclose(
        eqx.filter_jit(lambda e, y: e.gradient(y))(energy, y), gradient, rtol=0, atol=1e-13 * jnp.abs(gradient).max()
    )
    dense = jax.jit(jax.hessian(lambda y: value(energy, y)))(y)
    sparse = eqx.filter_jit(lambda e, y: e.hessian(y))(energy, y).as_matrix()
    assert jnp.allclose(sparse, dense, rtol=0, atol=1e-12 * jnp.abs(dense).max())


@pytest.mark.parametrize("name", sorted(ENERGIES))
def test_rest_shape_costs_nothing(name, mesh):
    energy = build(ENERGIES[name], mesh)
    y = energy.assembly.dofs.pack(Unknowns(mesh.vertices))
    assert abs(float(energy(y))) < 1e-20
    assert float(jnp.abs(energy.gradient(y)).max()) < 1e-12


@pytest.mark.parametrize("name", sorted(ENERGIES))
def test_rigid_motions_cost_nothing(name, mesh):
    energy = build(ENERGIES[name], mesh)
    y = shape(energy, mesh)
    state = energy.state(y)
    rotation = jnp.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    rotation = rotation * jnp.sign(jnp.linalg.det(rotation))
    moved = energy.assembly.dofs.pack(
        Unknowns(state.vertices @ rotation.T + jnp.array([3.0, -2.0, 5.0]), state.directors)
    )
    assert np.isclose(float(energy(moved)), float(energy(y)), rtol=1e-10)


@pytest.mark.parametrize("name", sorted(set(ENERGIES) - {"springs", "sum"}))
@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_scale_of_the_shell_does_not_change_digits(name, scale):
    mesh = MESHES["closed"]
    small = mesh.with_vertices(scale * mesh.vertices)
    energy, scaled = build(ENERGIES[name], mesh), build(ENERGIES[name], small, 0.1 * scale)
    y = shape(energy, mesh)
    power = 0 if name == "dihedral" else 3
    assert np.isclose(float(scaled(scale * y)) / scale**power, float(energy(y)), rtol=1e-10)


def test_weights_scale_and_nest():
    mesh = MESHES["closed"]
    single = build(ENERGIES["stvk"], mesh)
    y = shape(single, mesh)
    term = ENERGIES["stvk"]
    for composed, factor in ((2.0 * term, 2.0), (0.5 * (term + 3.0 * term), 2.0), (term * jnp.asarray(1.5), 1.5)):
        assert np.isclose(float(build(composed, mesh)(y)), factor * float(single(y)), rtol=1e-14)


def test_weight_is_differentiable():
    mesh = MESHES["closed"]
    problem = sk.InverseProblem(mesh=mesh, thickness=0.1, energy=ENERGIES["stvk"] + 2.0 * ENERGIES["bending-sin"])
    y = mesh.vertices * 1.1
    gradient = eqx.filter_grad(lambda p: p.total_energy(y))(problem)
    bending = sk.InverseProblem(mesh=mesh, thickness=0.1, energy=ENERGIES["bending-sin"])
    assert np.isclose(float(gradient.energy.terms[1].weight), float(bending.total_energy(y)), rtol=1e-12)


def test_pattern_is_no_larger_than_the_true_one():
    """The sparsity against that found by running the energy itself on random directions: asdex."""
    asdex = pytest.importorskip("asdex")
    mesh = MESHES["closed"]
    for name in ("stvk", "bending-sin", "springs"):
        energy = build(ENERGIES[name], mesh)
        y = shape(energy, mesh)
        pattern = energy.assembly.pattern
        ours = np.zeros((pattern.n, pattern.n), bool)
        ours[np.asarray(pattern.rows), np.asarray(pattern.indices)] = True
        ours |= ours.T
        dense = np.asarray(jax.hessian(lambda y, energy=energy: energy(y))(y)) != 0
        assert not (dense & ~ours).any(), name
        detected = asdex.hessian_sparsity(lambda y, energy=energy: energy(y), y)
        assert (ours <= np.asarray(detected.todense(), bool)).all(), name


def test_stretching_couples_only_the_corners_of_a_face():
    mesh = MESHES["closed"]
    stretch, full = build(ENERGIES["stvk"], mesh), build(ENERGIES["stvk"] + ENERGIES["bending-sin"], mesh)
    edges = mesh.n_edges
    # Upper triangle: six entries a vertex and nine an edge.
    assert stretch.assembly.pattern.nnz == 6 * mesh.n_vertices + 9 * edges
    assert stretch.assembly.pattern.nnz < 0.45 * full.assembly.pattern.nnz


@pytest.mark.parametrize("form", ["sin", "tan", "theta"])
@pytest.mark.parametrize("angle", [179.0, 179.9999, 180.0])
def test_folded_hinges_are_finite(form, angle):
    fold = np.deg2rad(180.0 - angle)
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, np.cos(fold), np.sin(fold)]])
    flat = sk.Mesh(np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0.0]]), np.array([[0, 1, 2], [1, 0, 3]]))
    energy = build(sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0, form=form), flat)
    y = jnp.asarray(vertices).reshape(-1)
    assert (
        jnp.isfinite(energy(y))
        and jnp.isfinite(energy.gradient(y)).all()
        and jnp.isfinite(energy.hessian(y).values).all()
    )


@pytest.mark.parametrize("aspect", [1e2, 1e4])
def test_needles_are_finite(aspect):
    mesh = sk.Mesh(
        np.array([[0, 0, 0], [1, 0, 0], [0.5, 1 / aspect, 0], [0.5, -1, 0.0]]), np.array([[0, 1, 2], [1, 0, 3]])
    )
    energy = build(sk.NeoHookean(1.0, 1.0) + sk.Bending(1.0, 1.0, form="tan"), mesh)
    y = shape(energy, mesh, size=0.1 / aspect)
    assert (
        jnp.isfinite(energy(y))
        and jnp.isfinite(energy.gradient(y)).all()
        and jnp.isfinite(energy.hessian(y).values).all()
    )


def test_translation_by_a_million():
    mesh = MESHES["closed"]
    energy = build(ENERGIES["sum"], mesh)
    y = shape(energy, mesh)
    state = energy.state(y)
    far = energy.assembly.dofs.pack(Unknowns(state.vertices + 1e6, state.directors))
    assert np.isclose(float(energy(far)), float(energy(y)), rtol=1e-6)


def test_wrong_moduli_and_options_are_refused():
    mesh = MESHES["closed"]
    with pytest.raises(ValueError, match=r"alpha has shape \(3,\).*80"):
        sk.InverseProblem(mesh=mesh, thickness=0.1, energy=sk.Bending(jnp.ones(3), 1.0))
    with pytest.raises(ValueError, match="'free'"):
        sk.Bending(1.0, 1.0, directors="loose")
    with pytest.raises(ValueError, match="different ways"):
        sk.InverseProblem(mesh=mesh, thickness=0.1, energy=sk.Bending(1.0, 1.0) + sk.Bending(1.0, 1.0, form="tan"))

    class Outside(Springs):
        def stencil(self, mesh):
            return mesh.edges + 40

    with pytest.raises(ValueError, match=r"Outside\.stencil: element"):
        sk.InverseProblem(mesh=mesh, thickness=0.1, energy=Outside(jnp.asarray(1.0)))


class Floor(sk.EnergyTerm):
    """A weight above a floor at z = 0, through which it must not step."""

    guarded: bool = eqx.field(static=True)

    def stencil(self, mesh):
        return jnp.arange(mesh.n_vertices)[:, None]

    def element_energy(self, x, data):
        return x[0, 2]

    def longest_step(self, start, step):
        if not self.guarded:
            return None
        falling = step[:, 2] < 0
        return jnp.min(jnp.where(falling, -start[:, 2] / jnp.where(falling, step[:, 2], -1.0), jnp.inf))


@pytest.mark.parametrize(("guarded", "allowed"), [(True, [True, False]), (False, [True, True])])
def test_no_step_is_longer_than_a_term_allows(guarded, allowed):
    mesh = MESHES["closed"]
    y = (mesh.vertices + jnp.array([0.0, 0.0, 1.0 - jnp.min(mesh.vertices[:, 2])])).reshape(-1)
    down = jnp.tile(jnp.array([0.0, 0.0, -1.0]), mesh.n_vertices)
    admits = Feasible(build(Floor(guarded), mesh))
    assert [bool(admits(y, y + length * down)) for length in (0.99, 1.01)] == allowed
