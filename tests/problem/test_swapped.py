"""Every part of a problem can be swapped by `tree_at`: the answer is that of a problem built with it, or an error that
names the part and the remedy."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shellkit as sk


SHEET = sk.meshes.rectangle(length=1.0, width=1.0, cells=(4, 4))
CORNERS = [0, 4]
MOVED = SHEET.vertices[np.array(CORNERS)] + jnp.array([[0.0, 0.05, 0.02], [0.0, -0.05, 0.02]])
ANGLES = jnp.asarray(np.random.default_rng(0).uniform(0, np.pi, SHEET.n_faces))
ENERGY = sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0)
FREE = sk.StVenantKirchhoff(1.0, 1.0) + sk.Bending(1.0, 1.0, directors="free")
TARGET = SHEET.vertices * jnp.array([1.05, 0.95, 1.0])


def scene(**parts):
    given = {
        "mesh": SHEET,
        "thickness": 0.1,
        "energy": ENERGY,
        "actuation": sk.Nematic(ANGLES, 1.05),
        "loss": sk.VertexDistance(TARGET),
        "supports": sk.Pinned(CORNERS, positions=SHEET.vertices[np.array(CORNERS)]),
    }
    return sk.InverseProblem(**(given | parts))


@pytest.fixture(scope="module")
def built():
    return scene()


FLOATS = {
    "vertices": (lambda p: p.mesh.vertices, SHEET.vertices * jnp.array([1.0, 1.1, 1.0]), None),
    "thickness": (lambda p: p.thickness, jnp.asarray(0.12), {"thickness": 0.12}),
    "angle": (lambda p: p.actuation.angle, ANGLES + 0.3, {"actuation": sk.Nematic(ANGLES + 0.3, 1.05)}),
    "alpha": (
        lambda p: p.energy.terms[0].alpha,
        jnp.asarray(2.0),
        {"energy": sk.StVenantKirchhoff(2.0, 1.0) + sk.Bending(1.0, 1.0)},
    ),
    "pins": (lambda p: p.supports.positions, MOVED, {"supports": sk.Pinned(CORNERS, positions=MOVED)}),
    "target": (lambda p: p.loss.target, TARGET + 0.1, {"loss": sk.VertexDistance(TARGET + 0.1)}),
    "loss": (lambda p: p.loss, sk.FoldPenalty(), {"loss": sk.FoldPenalty()}),
    "actuation": (lambda p: p.actuation, sk.IsotropicGrowth(1.1), {"actuation": sk.IsotropicGrowth(1.1)}),
}


@pytest.mark.parametrize("part", FLOATS)
def test_a_part_swapped_gives_what_a_problem_built_with_it_does(built, part):
    where, new, parts = FLOATS[part]
    swapped = eqx.tree_at(where, built, new)
    if parts is None:
        pins = sk.Pinned(CORNERS, positions=built.supports.positions)
        parts = {"mesh": SHEET.with_vertices(new), "supports": pins}
    anew = scene(**parts)
    one, other = swapped(), anew()
    assert one.converged and other.converged
    np.testing.assert_allclose(one.vertices, other.vertices, atol=1e-9)
    np.testing.assert_allclose(swapped.evaluate()[0], anew.evaluate()[0], rtol=1e-9)


REFUSED = {
    "directors": (lambda p: p.energy, FREE, "energy"),
    "term": (lambda p: p.energy, ENERGY + sk.PointLoad([3], [0.0, 0.0, 1e-4]), "energy"),
    "supports": (lambda p: p.supports, sk.Clamped(CORNERS).on(SHEET), "supports"),
    "mesh": (lambda p: p.mesh, sk.meshes.rectangle(length=1.0, width=1.0, cells=(3, 4)), "mesh"),
    "faces": (lambda p: p.mesh, sk.Mesh(SHEET.vertices, np.roll(SHEET.faces, 1, axis=0)), "other vertices"),
    "selection": (lambda p: p.supports.vertices, jnp.array([0, 3], jnp.int32), "other vertices"),
    "angles": (lambda p: p.actuation.angle, jnp.zeros(3), r"shape \(3,\)"),
    "layers": (lambda p: p.actuation, sk.Nematic(jnp.zeros(7), 1.1), r"shape \(7,\)"),
    "target": (lambda p: p.loss.target, jnp.zeros((3, 3)), "for 3 vertices"),
    "height": (lambda p: p.thickness, jnp.ones(5), r"thickness has shape \(5,\)"),
}


@pytest.mark.parametrize("part", REFUSED)
def test_a_part_that_does_not_fit_is_refused_by_name(built, part):
    where, new, message = REFUSED[part]
    swapped = eqx.tree_at(where, built, new)
    with pytest.raises(ValueError, match=message):
        swapped.evaluate()
    # Where it is traced, which vertices are named is not looked at.
    if message != "other vertices":
        with pytest.raises(ValueError, match=message):
            eqx.filter_jit(lambda p: p.evaluate()[0])(swapped)


def test_what_was_refused_is_replaced():
    replaced = scene().replace(energy=FREE, supports=None)
    assert replaced().directors is not None
    np.testing.assert_allclose(replaced().energy, scene(energy=FREE, supports=None)().energy, rtol=1e-12)
    with pytest.raises(ValueError, match="there is no part 'material'"):
        replaced.replace(material=FREE)


def directional(problem, where, direction):
    """The derivative of the loss along a direction by differences, by `evaluate` and by `residuals`."""
    value = where(problem)
    at = lambda h: float(eqx.tree_at(where, problem, value + h * direction).evaluate()[0])
    differences = (8 * (at(1e-4) - at(-1e-4)) - (at(2e-4) - at(-2e-4))) / 12e-4
    gradient = jax.grad(lambda x: eqx.tree_at(where, problem, x).evaluate()[0])(value)
    equilibrium = problem()
    squares = lambda x: jnp.sum(eqx.tree_at(where, problem, x).residuals(equilibrium) ** 2)
    by_residuals = jax.grad(squares)(value)
    return differences, float(jnp.vdot(gradient, direction)), float(jnp.vdot(by_residuals, direction))


@pytest.mark.parametrize("how", ["swapped", "built"])
def test_residuals_follow_supports_that_have_moved(built, how):
    """The sheet can spin about two pins, wherever they are."""
    problem = eqx.tree_at(lambda p: p.supports.positions, built, MOVED)
    problem = problem if how == "swapped" else scene(supports=sk.Pinned(CORNERS, positions=MOVED))
    direction = jnp.asarray(np.random.default_rng(1).normal(size=SHEET.n_faces))
    differences, adjoint, residuals = directional(problem, lambda p: p.actuation.angle, direction)
    assert np.isclose(adjoint, differences, rtol=1e-6)
    assert np.isclose(residuals, differences, rtol=1e-6)


ARCH = SHEET.with_vertices(SHEET.vertices.at[:, 2].set(0.2 * SHEET.vertices[:, 0] ** 2))
THREE = [0, 2, 4]


@pytest.fixture(scope="module")
def arch():
    """Held at three points that are not in a line, about which it cannot spin."""
    pins = sk.Pinned(THREE, positions=ARCH.vertices[np.array(THREE)])
    return scene(mesh=ARCH, energy=ENERGY, supports=pins)


def test_supports_that_set_the_shell_free_are_refused(arch):
    where = lambda p: p.supports.positions
    straight = where(arch).at[:, 2].set(0.0)
    swapped = eqx.tree_at(where, arch, straight)
    with pytest.raises(ValueError, match="1 rigid motions free"):
        swapped()
    anew = arch.replace(supports=sk.Pinned(THREE, positions=straight))
    direction = jnp.asarray(np.random.default_rng(1).normal(size=SHEET.n_faces))
    differences, adjoint, residuals = directional(anew, lambda p: p.actuation.angle, direction)
    assert np.isclose(adjoint, differences, rtol=1e-6)
    assert np.isclose(residuals, differences, rtol=1e-6)

    # Where they are traced this is not seen; there the singular Hessian gives no number.
    equilibrium = anew()

    def slope(straight):
        moved = eqx.tree_at(where, arch, straight)
        squares = lambda a: jnp.sum(eqx.tree_at(lambda p: p.actuation.angle, moved, a).residuals(equilibrium) ** 2)
        return jnp.vdot(jax.grad(squares)(ANGLES), direction)

    found = jax.jit(slope)(straight)
    assert jnp.isnan(found) or np.isclose(found, differences, rtol=1e-6)


def test_supports_that_contradict_each_other_are_refused():
    pins = lambda positions: sk.Pinned(CORNERS, positions=positions)
    both = scene(supports=pins(MOVED) + sk.Pinned([4], positions=MOVED[1:]))
    swapped = eqx.tree_at(lambda p: p.supports.terms[1].positions, both, MOVED[1:] + 0.1)
    with pytest.raises(ValueError, match="vertex 4"):
        swapped()


def test_nothing_derived_stands_twice(built):
    leaves = [leaf for leaf in jax.tree.leaves(built) if eqx.is_array(leaf) and leaf.size > 20]
    same = [
        (a.shape, a.dtype)
        for k, a in enumerate(leaves)
        for b in leaves[:k]
        if a.shape == b.shape and a.dtype == b.dtype and bool(jnp.array_equal(a, b))
    ]
    # The target of the loss, and positions of supports, may well be vertices of the mesh.
    assert same == []


def test_a_problem_is_built_inside_transformations():
    left = jnp.isclose(SHEET.vertices[:, 0], 0.0)

    def loss(angle, young, thickness, target, vertices):
        material = sk.StVenantKirchhoff.from_young(young, 0.3) + sk.Bending.from_young(young, 0.3)
        problem = sk.InverseProblem(
            mesh=SHEET.with_vertices(vertices),
            thickness=thickness,
            actuation=sk.Nematic(angle, stretch=1.05),
            energy=material,
            supports=sk.Clamped(left),
            loss=sk.VertexDistance(target, aligner=sk.NoAlignment()),
        )
        return problem.evaluate()[0]

    at = (ANGLES, jnp.asarray(1.0), jnp.asarray(0.1), TARGET, SHEET.vertices)
    value, gradients = jax.jit(jax.value_and_grad(loss, argnums=(0, 1, 2, 3, 4)))(*at)
    np.testing.assert_allclose(value, loss(*at), rtol=1e-10)
    for k in (0, 2, 3, 4):
        direction = jnp.asarray(np.random.default_rng(k).normal(size=at[k].shape)) * (0.01 if k == 2 else 1.0)
        moved = lambda h, k=k, direction=direction: loss(*at[:k], at[k] + h * direction, *at[k + 1 :])
        differences = (8 * (moved(1e-4) - moved(-1e-4)) - (moved(2e-4) - moved(-2e-4))) / 12e-4
        assert np.isclose(jnp.vdot(gradients[k], direction), differences, rtol=1e-5), k
    mapped = jax.lax.map(lambda h: loss(at[0], at[1], h, *at[3:]), jnp.array([0.1, 0.12]))
    np.testing.assert_allclose(mapped[0], value, rtol=1e-10)


class Lowest(sk.Loss):
    """The height of some vertices, which must be there."""

    chosen: jax.Array

    def __call__(self, equilibrium, actuation):
        return jnp.mean(equilibrium.vertices[self.chosen, 2])

    def check(self, mesh, actuation):
        if int(self.chosen.max()) >= mesh.n_vertices:
            raise ValueError(f"Lowest: there is no vertex {int(self.chosen.max())}.")


def test_a_loss_may_look_at_its_values():
    """Where they are known; in a program they are traced."""
    mesh = sk.meshes.icosphere(0)
    energy = sk.StVenantKirchhoff(1.0, 1.0)
    problem = sk.InverseProblem(mesh, 0.1, energy, sk.Nematic(jnp.zeros(mesh.n_faces), 1.1), Lowest(jnp.arange(3)))
    value = problem.evaluate()[0]
    assert np.isclose(float(eqx.filter_jit(lambda p: p.evaluate()[0])(problem)), float(value), rtol=1e-12)
    with pytest.raises(ValueError, match="there is no vertex 12"):
        eqx.tree_at(lambda p: p.loss.chosen, problem, jnp.arange(10, 13)).evaluate()
