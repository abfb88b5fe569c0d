"""The papers behind a problem: those of its parts and of no others, and every part that has a source names it."""

import re
from typing import ClassVar

import jax.numpy as jnp
import optimistix as optx
import pytest

import shellkit as sk
from shellkit._citation import papers as _papers
from shellkit._energy import AbstractEnergy
from shellkit._solve.linear.base import AbstractSparseSolver


PAPERS = {name: value for name, value in vars(_papers).items() if name.isupper()}
NEWTON = (sk.SparseNewton, sk.Shift, sk.LineSearch, sk.Corrections, sk.SaddleEscape, sk.MixedSteps)
KINDS = (AbstractEnergy, sk.Actuation, sk.Loss, sk.Aligner, AbstractSparseSolver, *NEWTON, sk.InverseProblem)
PARTS = [value for value in vars(sk).values() if isinstance(value, type) and issubclass(value, KINDS)]


def papers_of(cls):
    return (_papers.CHEN_2018, _papers.WEISCHEDEL_2012) if cls is sk.Bending else cls.papers


def keys(text):
    return re.findall(r"^@\w+\{(\w+),$", text, re.M)


def problem(**parts):
    sheet = sk.meshes.rectangle(1.0, 1.0, cells=(2, 2))
    return sk.InverseProblem(sheet, 0.1, **parts)


def test_papers_of_the_parts_in_use():
    layer = sk.Nematic(angle=jnp.zeros(8), stretch=1.1)
    shell = problem(
        energy=sk.StVenantKirchhoff(1.0, 1.0) + 2.0 * sk.Bending(1.0, 1.0, directors="free"),
        actuation=sk.Bilayer(layer, layer),
        loss=1e-3 * sk.FoldPenalty() + sk.VertexDistance(jnp.zeros((9, 3)), aligner=sk.Kabsch()),
        solver=sk.SparseNewton(linear_solver=sk.SuperLU()),
    )
    text = shell.citation()
    assert set(keys(text)) == {
        *("bradbury2018jax", "kidger2021equinox", "rader2024optimistix", "nocedal2006numerical", "gill1981practical"),
        *("teran2005robust", "magisano2017improve", "knyazev2001toward"),
        *("chen2018physical", "weischedel2012discrete", "aharoni2014geometry", "vanrees2017growth"),
        *("grinspun2003discrete", "kabsch1976solution", "demmel1999supernodal"),
    }
    assert len(keys(text)) == len(set(keys(text)))
    assert "% StVenantKirchhoff, Bending\n@article{chen2018physical," in text
    assert text.count("{") == text.count("}")


def test_no_papers_of_parts_that_are_not_there():
    plain = problem(energy=sk.StVenantKirchhoff(1.0, 1.0), solver=optx.BFGS(1e-3, 1e-6))
    assert set(keys(plain.citation())) == {
        *("bradbury2018jax", "kidger2021equinox", "rader2024optimistix", "chen2018physical"),
    }


def test_a_part_of_ones_own_names_its_own():
    class Springs(sk.EnergyTerm):
        papers: ClassVar[tuple[str, ...]] = ("@article{hooke1678restitutiva,\n    year = {1678},\n}",)

        def stencil(self, mesh):
            return mesh.edges

        def element_energy(self, x, data):
            return jnp.sum((x[0] - x[1]) ** 2)

    mine = problem(energy=0.5 * Springs() + sk.StVenantKirchhoff(1.0, 1.0))
    assert "% Springs\n@article{hooke1678restitutiva," in mine.citation()


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.__name__)
def test_parts_cite_what_their_docstrings_cite(part):
    if "??? cite" in part.__doc__:
        assert papers_of(part), "its docstring has a source, and its papers are empty"
    # Loads and foundations are of the textbooks; materials and solvers have their papers.
    if issubclass(part, (sk.FormEnergy, AbstractSparseSolver)) and part is not sk.FormEnergy:
        assert papers_of(part)
    for paper in papers_of(part) if part is not sk.InverseProblem else ():
        author = re.search(r"author = \{(.*?)[,}]", paper)[1]
        title = re.search(r"title = \{(\w+)", paper)[1]
        whole = part.__doc__ + (sk.mean_curvature.__doc__ + sk.gauss_curvature.__doc__ + sk.second_form.__doc__)
        assert author in whole or title in whole, f"{author} stands in no docstring"


def test_papers_are_bibtex():
    for name, paper in PAPERS.items():
        assert len(keys(paper)) == 1 and paper.count("{") == paper.count("}"), name
        for field in ("author", "title"):
            assert re.search(rf"^    {field} = \{{", paper, re.M), name
    assert len({keys(paper)[0] for paper in PAPERS.values()}) == len(PAPERS)
