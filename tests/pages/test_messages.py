"""The pages that explain messages speak of messages that there are."""

import ast
import re
from pathlib import Path

import shellkit as sk
from docs import messages


ROOT = Path(__file__).parents[2]
PAGES = ROOT / "docs" / "how-to"


def texts_of_the_package():
    """All texts in the source, those with names filled in as one with `…` for each."""
    for path in messages.PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str)):
                yield messages.text_of(node)


def test_messages_that_are_explained_exist():
    page = (PAGES / "troubleshooting.md").read_text()
    tables = page.split("## No message")[0]
    explained = [text for row in re.findall(r"^\| (`.*?) \|", tables, re.M) for text in re.findall("`([^`]+)`", row)]
    assert len(explained) > 25
    texts = list(texts_of_the_package())
    unknown = [
        part
        for text in explained
        for part in map(str.strip, text.split("…"))
        if part and not any(part in known for known in texts)
    ]
    assert not unknown


def test_every_way_a_relaxation_ends_is_explained():
    page = (PAGES / "diagnostics.md").read_text()
    named = re.findall(r"^    (\w+) = \($", (ROOT / "shellkit" / "_equilibrium.py").read_text(), re.M)
    assert len(named) >= 3 and all(hasattr(sk.RESULTS, name) for name in named)
    assert [name for name in named if f"(`{name}`)" not in page] == []


def test_the_page_of_messages_has_those_of_every_part():
    table = messages.table()
    assert messages.on_page_markdown("a\n<!-- messages -->") == f"a\n{table}"
    for text in ("needs double precision", "There is no such message", "unused vertex: no face has vertex …"):
        assert (text in table) == (text != "There is no such message")
    sections = re.findall(r"^## (.*)\n\n- ", table, re.M)
    assert set(sections) == {*messages.PARTS.values(), messages.OTHERS}
    assert len(re.findall("^- ", table, re.M)) > 200
