"""What strangers meet first agrees with itself: the name to install, the version, the citation, the hooks, the
templates and the workflow."""

import re
import tomllib
from pathlib import Path

import yaml

import shellkit as sk
from shellkit._package.distribution import DISTRIBUTION


ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text())
TEXTS = [
    *sorted((ROOT / "shellkit").rglob("*.py")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *ROOT.glob("*.md"),
    *sorted((ROOT / "examples").glob("*.*")),
]


def test_the_name_is_written_in_one_place_of_the_code():
    assert PROJECT["name"] == DISTRIBUTION
    written = [path.name for path in (ROOT / "shellkit").rglob("*.py") if DISTRIBUTION in path.read_text()]
    assert written == ["distribution.py"]


def test_what_is_to_be_installed_is_ours():
    """`shellkit` on PyPI is another package."""
    for path in TEXTS:
        text = path.read_text().replace("{DISTRIBUTION}", DISTRIBUTION)
        assert not re.search(r"\bshellkit\[\w|pip install '?shellkit\b(?!-jax)", text), path
        for extra in re.findall(rf"{DISTRIBUTION}\[(\w+)\]", text):
            assert extra in PROJECT["optional-dependencies"], path


def test_citation_is_of_this_version():
    assert CITATION["version"] == sk.__version__
    assert CITATION["license"] == PROJECT["license"]
    assert [author["name"] for author in CITATION["authors"]] == [author["name"] for author in PROJECT["authors"]]
    assert {"cff-version", "message", "title", "type"} < set(CITATION)


def test_changelog_has_what_is_in_work_and_this_version():
    headings = re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert headings[0] == "Unreleased" and headings[1].startswith(sk.__version__)
    kinds = set(re.findall(r"^### (.*)$", (ROOT / "CHANGELOG.md").read_text(), re.M))
    assert kinds <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}


def test_a_report_of_a_fault_says_where_it_runs():
    template = (ROOT / ".github" / "ISSUE_TEMPLATE" / "bug_report.md").read_text()
    head = yaml.safe_load(template.split("---")[1])
    assert {"name", "about"} <= set(head) and "sk.about()" in template
    assert "sk.about()" in (ROOT / "docs" / "how-to" / "troubleshooting.md").read_text()


def test_hooks_run_the_checks_of_ci():
    hooks = [
        hook
        for repository in yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"]
        for hook in repository["hooks"]
    ]
    commands = [hook["entry"] for hook in hooks]
    script = (ROOT / ".ci" / "run").read_text()
    for command in ("ruff check", "ruff format", "pyright"):
        assert any(entry.startswith(command) for entry in commands) and f'"$venv"/bin/{command}' in script


def test_the_workflow_runs_ci_on_pythons_that_are_named():
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text())
    (job,) = workflow["jobs"].values()
    assert any(step.get("run") == "bash .ci/run" for step in job["steps"])
    named = {entry.rpartition(" ")[2] for entry in PROJECT["classifiers"] if entry.startswith("Programming Language")}
    assert set(job["strategy"]["matrix"]["python"]) <= named
    assert PROJECT["requires-python"] == f">={min(named - {'3'}, key=lambda version: int(version[2:]))}"


def test_signatures_in_the_documentation_are_formatted():
    """mkdocstrings breaks them into lines if it finds a formatter, and else says nothing."""
    assert any(name.startswith("ruff") for name in PROJECT["optional-dependencies"]["docs"])
