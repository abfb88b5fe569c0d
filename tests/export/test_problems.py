"""A problem that was saved and loaded is the same problem, to the last bit; what cannot be is named."""

import json
import os

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from jaxtyping import Array

import shellkit as sk
from shellkit._export.structure import _package, _subclasses, known_classes


MESH = sk.meshes.rectangle(2.0, 1.0, cells=(6, 3))
LEFT = lambda x: x[:, 0] < jnp.min(x[:, 0]) + 0.01
SHELL = sk.StVenantKirchhoff(alpha=1.0, beta=2.0) + 0.5 * sk.Bending(alpha=1.0, beta=1.0)
BALL = sk.meshes.icosphere(1)


class Springs(sk.EnergyTerm):
    """An energy that a user wrote, with a name, a pair and a flag among its fields."""

    stiffness: Array
    label: str = eqx.field(static=True)
    limits: tuple = eqx.field(static=True)

    def stencil(self, mesh):
        return mesh.edges

    def element_energy(self, x, data):
        return 0.5 * self.stiffness * jnp.sum((x[0] - x[1]) ** 2)


SPRINGS = Springs(jnp.asarray(0.3), "weak", (0.5, float("inf"), None, True))


def same(a, b):
    """Equal structure, and arrays equal bit for bit."""
    leaves, structure = jax.tree.flatten(a)
    others, other = jax.tree.flatten(b)
    assert structure == other
    for x, y in zip(leaves, others, strict=True):
        assert type(x) is type(y)
        if eqx.is_array(x):
            assert x.dtype == y.dtype and x.shape == y.shape and np.asarray(x).tobytes() == np.asarray(y).tobytes()
        else:
            assert x == y
    return True


def round_trip(thing, tmp_path, **options):
    path = sk.save(thing, tmp_path / "thing.npz")
    assert os.listdir(tmp_path) == ["thing.npz"]
    return sk.load(path, **options)


def test_a_loaded_problem_relaxes_to_the_same_energy(tmp_path):
    bent = sk.Bilayer(*(sk.Nematic(sk.director_angles(MESH, jnp.array([1.0, 0.2, 0.0])), s) for s in (1.1, 0.95)))
    problem = sk.InverseProblem(
        MESH, 0.05, SHELL + sk.Gravity(1e-3), bent, sk.VertexDistance(MESH.vertices), supports=sk.Clamped(LEFT)
    )
    again = round_trip(problem, tmp_path)
    assert same(problem, again)
    before, after = problem(), again()
    assert before.converged and same(before.vertices, after.vertices) and same(before.energy, after.energy)
    assert same(problem.evaluate()[0], again.evaluate()[0])


ANGLES = jnp.linspace(0, 3, MESH.n_faces)
PARTS = {
    "mesh with data": lambda: sk.Mesh(
        MESH.vertices, MESH.faces, {"flag": np.arange(MESH.n_vertices) > 3}, {"tensor": np.ones((MESH.n_faces, 2, 2))}
    ),
    "neo-Hooke": lambda: sk.NeoHookean(bulk=1.0, shear=2.0) + sk.DihedralBending(1.0),
    "load": lambda: sk.Pressure(0.1) + sk.PointLoad([3], jnp.array([[0.0, 0.0, 1.0]])) + sk.Foundation(1.0),
    "contact": lambda: 2.0 * sk.PlaneContact([0.0, 0.0, -1.0], [0.0, 0.0, 1.0], stiffness=10.0, softness=0.01),
    "growth": lambda: sk.OrthotropicGrowth(ANGLES, 1.1, 0.9),
    "laminate": lambda: sk.Laminate([sk.Layer(), sk.Layer(sk.Nematic(ANGLES, 1.1), thickness=2.0)]),
    "supports": lambda: sk.Clamped([0, 1]) + sk.Sliding([5], normal="x") + sk.Pinned([7], displacement=jnp.ones(3)),
    "losses": lambda: sk.PointToSurface(BALL) + 2.0 * sk.Varifold(BALL) + sk.Area(3.0) + sk.StrainLimit(0.9, 1.1),
    "aligner": lambda: sk.ICP(BALL.faces, start=sk.Landmarks([0, 1, 2])),
    "solver": lambda: sk.SparseNewton(max_steps=7, linear_solver=sk.SuperLU()),
    "BFGS": lambda: optx.BFGS(rtol=1e-6, atol=1e-8),
    "network": lambda: eqx.nn.Linear(2, 3, key=jax.random.key(0)),
    "values": lambda: {
        "numbers": [1, 2.5, float("-inf"), None, True, "é"],
        "arrays": (np.arange(3, dtype=np.uint8), np.float32(0.1), jnp.asarray(1 + 2j), jnp.zeros((0, 3))),
        "functions": [jax.nn.relu, jnp.tanh, optx.max_norm],
        "sets": frozenset({"a", "b"}),
        "bytes": b"\x00\xff",
    },
}


@pytest.mark.parametrize("part", PARTS)
def test_every_kind_of_part_comes_back(tmp_path, part):
    thing = PARTS[part]()
    assert same(thing, round_trip(thing, tmp_path))


def test_random_keys_come_back(tmp_path):
    key = jax.random.key(3)
    again = round_trip([key], tmp_path)[0]
    assert jnp.array_equal(jax.random.normal(key, 4), jax.random.normal(again, 4))


def test_the_solver_of_this_machine_is_not_stored(tmp_path):
    """It may not be there where the file is loaded; one that was chosen is kept."""
    for solver, stored in ((None, False), (sk.SparseNewton(linear_solver=sk.SuperLU()), True)):
        path = sk.save(sk.InverseProblem(MESH, 0.05, SHELL, solver=solver), tmp_path / "a.npz")
        with np.load(path, allow_pickle=False) as file:
            assert (b"SparseNewton" in file["structure"].tobytes()) == stored
        assert same(sk.load(path).solver, sk.SparseNewton() if solver is None else solver)


def test_an_array_in_two_places_is_stored_once(tmp_path):
    sk.save(sk.Bilayer(sk.Nematic(ANGLES, 1.1), sk.Nematic(ANGLES, 1.2)), tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as stored:
        assert sum(stored[name].shape == ANGLES.shape for name in stored.files) == 1


def test_what_a_fit_found_is_saved(tmp_path):
    problem = sk.InverseProblem(MESH, 0.05, SHELL)
    result = sk.FitResult(problem, 0.0, 0, None, problem, sk.History(), "steps", None)
    assert same(problem, round_trip(result, tmp_path))


def test_classes_of_a_user_are_handed_over_and_never_imported(tmp_path):
    with pytest.raises(ValueError, match=r"problem is a Springs of .*test_problems, whose class is not at hand"):
        round_trip(SPRINGS, tmp_path)
    path = tmp_path / "thing.npz"
    assert same(SPRINGS, sk.load(path, classes=[Springs]))
    other = type("Springs", (eqx.Module,), {"__module__": "elsewhere", "__qualname__": "Springs"})
    with pytest.raises(ValueError, match=r"with the fields stiffness, label, limits, and this Springs has"):
        sk.load(path, classes=[other])


def test_functions_and_strangers_are_named_with_their_place(tmp_path):
    class Local(eqx.Module):
        number: float = 1.0

    path = tmp_path / "a.npz"
    for part, message in {
        "function": (lambda x: x, r"problem\['a'\]\[1\] is the function .*lambda.*equinox\.Module with a __call__"),
        "object": (object(), r"problem\['a'\]\[1\] is a object, which cannot be stored"),
        "local": (Local(), r"is a Local, a class that is defined within a function"),
        "strings": (np.array(["a"]), r"is an array of type <U1; numbers and flags can be stored"),
    }.values():
        with pytest.raises(ValueError, match=message):
            sk.save({"a": [1, part]}, path)
    with pytest.raises(ValueError, match="traced"):
        jax.jit(lambda x: sk.save({"a": x}, path) and x)(1.0)
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        sk.save(SHELL, tmp_path / "none" / "a.npz")
    assert os.listdir(tmp_path) == []


def changed(path, change):
    with np.load(path, allow_pickle=False) as stored:
        arrays = {name: stored[name] for name in stored.files}
    header = json.loads(arrays["structure"].tobytes())
    change(header)
    arrays["structure"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    np.savez(path, **arrays)


def test_files_of_others_and_of_other_versions_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    with pytest.raises(FileNotFoundError):
        sk.load(path)
    for content in (b"", b"nonsense", b"\x80\x04K\x01."):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"a\.npz is no file of sk\.save, or damaged"):
            sk.load(path)
    np.savez(path, structure=np.array([object()], dtype=object))
    with pytest.raises(ValueError, match="is no file of sk"):
        sk.load(path)
    np.savez(path, x=np.zeros(3))
    with pytest.raises(ValueError, match="is no file of sk"):
        sk.load(path)
    for change, message in (
        (lambda h: h.update(version=2), "has version 2 of the format, and this shellkit knows it up to 1"),
        (lambda h: h.update(format="x"), "holds a 'x', which is nothing"),
        (lambda h: h["root"].update({"class": "shellkit:Nothing"}), "the shellkit installed here does not have it"),
        (lambda h: h["root"].pop("fields"), r"a\.npz is damaged: it lacks 'fields'"),
        (lambda h: h["root"].update({"class": "os:system"}), "is a system of os, whose class is not at hand"),
        (lambda h: h["root"].update({"is": "function", "name": "os:system"}), "function os:system, which is not known"),
        (
            lambda h: h["root"]["fields"].pop("alpha"),
            r"with the fields beta, and this StVenantKirchhoff has alpha, beta",
        ),
    ):
        sk.save(sk.StVenantKirchhoff(alpha=1.0, beta=1.0), path)
        changed(path, change)
        with pytest.raises(ValueError, match=message):
            sk.load(path)


def test_names_of_classes_tell_them_apart():
    classes = {cls for cls in _subclasses(eqx.Module) if _package(cls) is not None}
    assert len(known_classes()) == len(classes) > 100
