"""What holds for the package as a whole: what importing it costs, what it shows, how its parts may lean on each other,
and that all it shows is documented, in words that run."""

import ast
import functools
import importlib
import inspect
import pkgutil
import re
import subprocess
import sys
import types
from pathlib import Path

import equinox as eqx
import pytest

import shellkit


ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "shellkit"
SOURCES = sorted(PACKAGE.rglob("*.py"))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]

# A part may import itself and the parts of lower rows, never one of its own row or above.
LAYERS = [
    {"_programs", "_citation"},
    {"_mesh", "_solve"},
    {"meshes", "_geometry", "_package"},
    {"_rest", "_supports", "_align"},
    {"_actuation", "_energy"},
    {"_fields"},
    {"_equilibrium", "_starts"},
    {"_loss"},
    {"_relaxation"},
    {"_problem"},
    {"_path", "_fit"},
    {"_analysis"},
    {"_plot", "_fabrication"},
    {"_export"},
]

# Methods that a base class answers for everybody, and that a class may answer better.
REFINABLE = {
    "element_data",
    "director_moments",
    "residuals",
    "check",
    "sees_motion",
    "needs_shape",
    "at",
    "on",
    "name",
    "director_fields",
    "engaged",
    "longest_step",
    "accept",
    "refuse",
    "arrived",
}

# Files that are still to be divided.
TOO_LONG = {"_problem/problem.py"}


def run(*command):
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, stdin=subprocess.DEVNULL)


def public_names():
    """`{"Mesh": …, "meshes.disc": …}`: all that a user can reach without an underscore."""
    names = {}
    for prefix, namespace in (("", shellkit), ("meshes.", shellkit.meshes)):
        for name, value in vars(namespace).items():
            if not name.startswith("_") and not isinstance(value, types.ModuleType):
                names[prefix + name] = value
    return names


def documented_names():
    pages = (ROOT / "docs" / "api").glob("*.md")
    return [name for page in pages for name in re.findall(r"^::: shellkit\.([\w.]+)$", page.read_text(), re.M)]


def modules_of_the_package():
    """Every Equinox module class that the package defines at the top of a file."""
    for found in pkgutil.walk_packages(shellkit.__path__, "shellkit."):
        importlib.import_module(found.name)
    unseen, classes = [eqx.Module], set()
    while unseen:
        for cls in unseen.pop().__subclasses__():
            if cls not in classes:
                unseen.append(cls)
                classes.add(cls)
    return sorted(filter(is_ours, classes), key=lambda c: (c.__module__, c.__name__))


def is_ours(cls):
    inside = cls.__module__.partition(".")[0] == "shellkit"
    return inside and getattr(sys.modules[cls.__module__], cls.__name__, None) is cls


def is_abstract(cls):
    return bool(cls.__abstractmethods__ or cls.__abstractvars__ or cls.__abstractclassvars__)


@functools.cache
def class_body(cls):
    """The syntax of a class as it was written, without what dataclasses and Equinox add to it."""
    return ast.parse(inspect.getsource(cls)).body[0].body


def written_methods(cls):
    """The methods and properties in the text of a class, by name, with whether each is only declared."""
    methods = {}
    for node in class_body(cls):
        if isinstance(node, ast.FunctionDef):
            methods[node.name] = any("abstract" in ast.unparse(decorator) for decorator in node.decorator_list)
    return methods


def written_fields(cls):
    annotated = [node for node in class_body(cls) if isinstance(node, ast.AnnAssign)]
    return [node.target.id for node in annotated if not re.search("Abstract|ClassVar", ast.unparse(node.annotation))]


def ancestors(cls):
    return [base for base in cls.__mro__[1:] if is_ours(base)]


def test_import_loads_nothing_that_can_wait():
    heavy = "rich pyvista vtk vtkmodules meshio matplotlib scipy.sparse scipy.spatial pardiso_mkl_jax sparsax"
    program = (
        "import sys, jax, equinox, optimistix, lineax; before = set(sys.modules); import shellkit;"
        f"print([m for m in {heavy.split()} if m in sys.modules and m not in before])"
    )
    done = run(sys.executable, "-c", program)
    assert (done.stdout.strip(), done.returncode) == ("[]", 0), done.stderr


def test_import_leaves_precision_to_the_user():
    done = run(sys.executable, "-c", "import shellkit, jax; print(jax.config.jax_enable_x64)")
    assert (done.stdout.strip(), done.returncode) == ("False", 0), done.stderr


def test_every_public_name_has_a_docstring():
    undocumented = []
    for name, value in public_names().items():
        if not callable(value):
            continue
        # A dataclass without a docstring is given its signature for one.
        if not value.__doc__ or value.__doc__.startswith(f"{name}("):
            undocumented.append(name)
        if inspect.isclass(value):
            methods = [m for m in value.__dict__ if not m.startswith("_")]
            kinds = (types.FunctionType, property, classmethod, staticmethod)
            methods = [m for m in methods if isinstance(value.__dict__[m], kinds)]
            undocumented += [f"{name}.{m}" for m in methods if not inspect.getdoc(getattr(value, m))]
    assert not undocumented


def described(value):
    """What a function or a class takes, what it says of that, and the syntax of what it does with it."""
    if not inspect.isclass(value):
        function = inspect.unwrap(value)
        body = ast.parse(inspect.getsource(function)).body
        return list(inspect.signature(function).parameters), inspect.getdoc(function), body
    text = inspect.getdoc(value)
    for node in class_body(value):
        if isinstance(node, ast.FunctionDef) and node.name == "__init__":
            taken = [argument.arg for argument in [*node.args.args[1:], *node.args.kwonlyargs]]
            return taken, f"{text}\n{ast.get_docstring(node) or ''}", [node]
    nodes = class_body(value)
    following = zip(nodes, [*nodes[1:], None], strict=True)
    told = {
        node.target.id for node, after in following if isinstance(node, ast.AnnAssign) and isinstance(after, ast.Expr)
    }
    taken = [name for name in written_fields(value) if not name.startswith("_") and name not in told]
    return taken, text, []


def test_docstrings_say_what_is_taken_returned_and_refused():
    silent = []
    for name, value in public_names().items():
        if not callable(value) or name == "RESULTS":
            continue
        taken, text, body = described(value)
        silent += [f"{name}: {argument}" for argument in taken if f"`{argument}`" not in text]
        if not inspect.isclass(value) and "**Returns:**" not in text:
            silent.append(f"{name} returns something")
        if any(isinstance(node, ast.Raise) for part in body for node in ast.walk(part)) and "**Raises:**" not in text:
            silent.append(f"{name} raises something")
    assert not silent


def test_api_pages_hold_exactly_the_public_names():
    documented = documented_names()
    assert sorted(documented) == sorted(set(documented)), "a name stands on two pages"
    missing = set(public_names()) - set(documented)
    stale = set(documented) - set(public_names())
    assert (missing, stale) == (set(), set())


def test_init_only_imports_names_as_themselves():
    for node in ast.parse((PACKAGE / "__init__.py").read_text()).body:
        if isinstance(node, ast.ImportFrom):
            assert node.level == 1 and all(alias.name == alias.asname for alias in node.names), ast.unparse(node)
        else:
            assert isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant), ast.unparse(node)


def test_modules_are_abstract_or_final():
    wrong = []
    for cls in modules_of_the_package():
        wrong += [
            f"{cls.__name__} inherits from {b.__name__}, which is final" for b in ancestors(cls) if not is_abstract(b)
        ]
        for method in written_methods(cls):
            concrete = [b for b in ancestors(cls) if written_methods(b).get(method) is False]
            if concrete and method not in REFINABLE:
                wrong.append(f"{cls.__name__}.{method} overrides that of {concrete[0].__name__}, which is concrete")
    assert not wrong


def test_fields_and_init_stand_in_one_class():
    wrong = []
    for cls in modules_of_the_package():
        if written_fields(cls) or "__init__" in written_methods(cls):
            wrong += [f"{cls.__name__} adds to {b.__name__}" for b in ancestors(cls) if written_fields(b)]
    assert not wrong


def imported_parts(path):
    """The parts of the package that a file imports, anywhere in it."""
    yield from (target[1] for target in imported_names(path) if len(target) > 1)


def imported_files(path):
    """The files of the package that a file imports, as dotted names within it."""
    for target in imported_names(path):
        yield ".".join(target[1:])
        yield ".".join(target[1:-1])


def imported_names(path):
    package = ["shellkit", *path.relative_to(PACKAGE).parent.parts]
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            module = [*base, *(node.module.split(".") if node.module else [])]
            targets = [[*module, alias.name] for alias in node.names]
        elif isinstance(node, ast.Import):
            targets = [alias.name.split(".") for alias in node.names]
        else:
            continue
        yield from (target for target in targets if target[0] == "shellkit")


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_run_downwards(path):
    rank = {part: row for row, parts in enumerate(LAYERS) for part in parts}
    own = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    if own == "__init__":
        return
    assert own in rank, f"{own} has no place in LAYERS"
    upwards = [part for part in imported_parts(path) if part != own and rank.get(part, len(LAYERS)) >= rank[own]]
    assert not upwards


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_files_hold_one_idea(path):
    assert "util" not in path.name
    lines = len(path.read_text().splitlines())
    assert lines <= 400 or (str(path.relative_to(PACKAGE)) in TOO_LONG and lines <= 450)


def test_rooms_hold_the_code():
    """What stands loose in the root is private modules that have no room: five at most."""
    loose = [path.name for path in PACKAGE.glob("_*.py") if path.name != "__init__.py"]
    assert len(loose) <= 5, loose


@pytest.mark.parametrize("room", ["_energy", "_fit", "_relaxation", "_solve", "_path", "_problem"])
def test_files_of_a_room_import_in_one_direction(room):
    """No circle within a room either; an `__init__` only hands names on."""
    paths = [path for path in (PACKAGE / room).rglob("*.py") if path.name != "__init__.py"]
    names = {".".join(path.relative_to(PACKAGE).with_suffix("").parts): path for path in paths}
    waiting = {name: {target for target in imported_files(path) if target in names} for name, path in names.items()}
    while ready := [name for name, targets in waiting.items() if not targets & set(waiting)]:
        for name in ready:
            del waiting[name]
    assert not waiting


def test_ci_runs_the_commands_of_the_readme():
    script = (ROOT / ".ci" / "run").read_text().replace('"$venv"', ".venv")
    commands = re.findall(r"\.venv/bin/(?:pip install -e '.*?'|python -m pytest.*)", (ROOT / "README.md").read_text())
    assert len(commands) == 2 and all(command in script for command in commands), commands


@pytest.mark.slow
@pytest.mark.parametrize("path", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_code_on_the_pages_runs(path):
    blocks = re.findall(r"^```python\n(.*?)^```$", path.read_text(), re.M | re.S)
    if blocks:
        done = run(sys.executable, "-c", "\n".join(blocks))
        assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_wheel_holds_the_package_and_nothing_else(tmp_path):
    from zipfile import ZipFile

    from hatchling.builders.wheel import WheelBuilder

    wheel = next(WheelBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"]))
    names = ZipFile(wheel).namelist()
    assert {name.partition("/")[0] for name in names} == {"shellkit", f"shellkit_jax-{shellkit.__version__}.dist-info"}
    assert "shellkit/py.typed" in names
    assert {Path(name).suffix for name in names if name.startswith("shellkit/")} == {".py", ".typed"}
