"""The benchmarks: all of them are found and know their pages, their results are small and say where they are from, and
cards and hard cases lean on nothing but the package."""

import ast
import importlib
import json
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.pages import PAGES
from benchmarks.questions import NAMES, module
from benchmarks.results import RESULTS, compact, load


ROOT = Path(__file__).parents[1]

# A part may import itself and the parts of lower rows, never one of its own row or above.
LAYERS = [
    {"conditions", "measure", "tutorial", "meshes"},
    {"case", "child", "problems", "peer"},
    {"results", "jobs"},
    {"tables"},
    {"questions"},
    {"__main__", "pages", "plot"},
]


def test_benchmarks_find_what_they_measure():
    """They look inside the package, and nothing else runs them."""
    for package in ("benchmarks", "validation"):
        names = [name for _, name, _ in pkgutil.walk_packages([str(ROOT / package)], f"{package}.")]
        ours = [name for name in names if not name.endswith(("__main__", "peer", "peers"))]
        assert len(ours) > 10
        for name in ours:
            importlib.import_module(name)


@pytest.mark.parametrize("name", NAMES)
def test_cases_name_what_they_call(name):
    for quick in (True, False):
        cases = module(name).cases(quick)
        assert cases and len({case.label for case in cases}) == len(cases)
        for case in cases:
            source = (ROOT / "benchmarks" / f"{case.module.replace('.', '/')}.py").read_text()
            functions = {node.name: node.args for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)}
            known = functions[case.function]
            names = {argument.arg for argument in known.args}
            needed = {argument.arg for argument in known.args[: len(known.args) - len(known.defaults)]}
            assert needed <= set(case.arguments)
            assert known.kwarg or set(case.arguments) <= names


def test_figures_on_the_pages_are_those_measured():
    command = [sys.executable, "-m", "benchmarks.pages", "--check"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.returncode == 0, f"run python -m benchmarks.pages: {done.stdout}{done.stderr}"


def test_every_benchmark_has_a_page():
    shown = {content.args[0] for blocks in PAGES.values() for content in blocks.values()}
    assert shown == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_results_say_their_commit(name):
    for row in load(name):
        assert ("commit" in row) != ("stored_in" in row), row["label"]
        assert row["date"] and row["label"]


def test_results_are_summaries():
    assert {path.stem for path in RESULTS.iterdir()} <= set(NAMES)
    assert sum(path.stat().st_size for path in RESULTS.iterdir()) < 200_000
    for path in RESULTS.iterdir():
        assert json.loads(path.read_text())["benchmark"] == path.stem
        assert "_probes" not in path.read_text()


def test_a_profile_is_summed_up():
    record = {"run_s": [3.0, 1.0, 2.0], "run_cpu_s": [1.0], "first_s": 9.0, "shape_probes": [1.0] * 64, "error": 1 / 3}
    short = {"first_s": 9.0, "error": 0.333333, "median_s": 2.0, "samples": 3, "span_s": [1.0, 3.0]}
    assert compact(record) == short
    assert compact({"run_s": [], "first_s": 9.0}) == {"first_s": 9.0, "median_s": 9.0, "samples": 1}
    assert compact({"trace": [{"loss": 1.0}, {"loss": float("nan")}]}) == {"trace": {"loss": [1.0, None]}}


def test_benchmarks_lean_downwards():
    rank = {name: row for row, names in enumerate(LAYERS) for name in names}
    for path in (ROOT / "benchmarks").rglob("*.py"):
        parts = path.relative_to(ROOT / "benchmarks").with_suffix("").parts
        if parts[0] in ("__init__", "raw"):
            continue
        for target in _imported(path, ("benchmarks", *parts)):
            if target[0] == "benchmarks" and len(target) > 1 and target[1] != parts[0]:
                assert rank[target[1]] < rank[parts[0]], f"{path} imports {target[1]}"


def test_cards_lean_on_the_package_only():
    for path in (ROOT / "validation").rglob("*.py"):
        parts = path.relative_to(ROOT).with_suffix("").parts
        assert not any(target[0] in ("benchmarks", "tests", "docs") for target in _imported(path, parts)), path


def _imported(path: Path, here: tuple[str, ...]) -> list[tuple[str, ...]]:
    """The modules that a file imports, as paths from the root."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found += [tuple(alias.name.split(".")) for alias in node.names]
        if isinstance(node, ast.ImportFrom):
            start = here[: len(here) - node.level] if node.level else ()
            module_path = start + tuple(node.module.split(".") if node.module else ())
            found += [(*module_path, alias.name) for alias in node.names]
    return found
