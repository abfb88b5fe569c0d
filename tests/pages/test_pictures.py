"""Pictures on the pages: there, light, made by a script, and shown by a page."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest


ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
LIGHT = 150_000  # bytes
PICTURES = [path for path in (DOCS / "assets").rglob("*.*") if path.suffix in (".png", ".webp", ".gif", ".svg")]
PAGES = [ROOT / "README.md", *DOCS.rglob("*.md")]


@pytest.mark.parametrize("page", sorted((DOCS / "concepts").glob("*.md")), ids=lambda page: page.stem)
def test_every_concept_has_a_picture(page):
    assert re.search(r"!\[[^\]]{20,}\]\(\.\./assets/", page.read_text()), "no picture that says what it shows"


def test_pictures_are_light_and_shown():
    assert len(PICTURES) > 15
    heavy = [path.name for path in PICTURES if path.stat().st_size > LIGHT]
    text = "\n".join(page.read_text() for page in PAGES)
    unseen = [path.name for path in PICTURES if path.name not in text]
    assert (heavy, unseen) == ([], [])


def test_pictures_are_made_by_a_script():
    made = {"history.png", "identifiability_spectrum.png"}  # beside training.webp, and by the example
    for script in ("pictures.py", "concept_pictures.py"):
        for node in ast.walk(ast.parse((DOCS / script).read_text())):
            if isinstance(node, ast.Constant) and str(node.value).endswith((".png", ".gif", ".webp")):
                made.add(node.value)
    others = {path.name for path in PICTURES if path.parent.name == "assets"}
    assert {name for name in others if not name.startswith(("benchmark_", "validation_"))} <= made


def test_the_gallery_has_every_example_with_its_script():
    page = (DOCS / "gallery.md").read_text()
    scripts = sorted(path.name for path in (ROOT / "examples").glob("*.py"))
    assert len(scripts) > 10 and re.findall(r'--8<-- "examples/(.*?)"', page) == scripts


def test_the_gallery_shows_what_is_stored():
    command = [sys.executable, "-m", "docs.gallery", "--check"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.returncode == 0, f"run python -m docs.gallery --page: {done.stdout}{done.stderr}"
