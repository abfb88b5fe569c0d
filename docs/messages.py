"""Every message that shellkit may raise or warn with, read from its source as the site is built, so that a reader who
searches the site for one finds it. A hook of mkdocs: the table stands where a page says `<!-- messages -->`."""

import ast
from collections.abc import Iterator
from pathlib import Path


PACKAGE = Path(__file__).parents[1] / "shellkit"
# The parts of the package, in the words of the navigation.
PARTS = {
    "_mesh": "Meshes",
    "_geometry": "Surfaces",
    "_problem": "Problems",
    "_relaxation": "Problems",
    "_programs": "Problems",
    "_package": "Problems",
    "_rest": "Problems",
    "_equilibrium": "Problems",
    "_actuation": "Actuation",
    "_energy": "Energy and loads",
    "_supports": "Supports",
    "_solve": "Solvers",
    "_loss": "Losses and alignment",
    "_align": "Losses and alignment",
    "_starts": "Training",
    "_path": "Paths and analysis",
    "_analysis": "Paths and analysis",
    "_plot": "Pictures and fabrication",
    "_fabrication": "Pictures and fabrication",
    "_fields": "Pictures and fabrication",
    "_export": "Pictures and fabrication",
}
OTHERS = "Training"


def messages(path: Path) -> Iterator[str]:
    """The texts that a file gives to exceptions and warnings, with `…` for what is filled in."""
    for node in ast.walk(ast.parse(path.read_text())):
        call = node.exc if isinstance(node, ast.Raise) else node
        if isinstance(call, ast.Call) and call.args:
            warned = isinstance(call.func, ast.Attribute) and call.func.attr in ("warn", "_warn")
            text = max(map(text_of, call.args), key=len)
            further = [text_of(word.value) for word in call.keywords if word.arg in ("remedy", "in_file")]
            text = " ".join([text, *further])
            if (isinstance(node, ast.Raise) or warned) and len(text) > 12:
                yield text


def text_of(node: ast.expr) -> str:
    """What a text in the source says, with `…` for what is filled in."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(text_of(value) for value in node.values)
    if isinstance(node, ast.BinOp):
        return text_of(node.left) + text_of(node.right)
    return "…"


def table() -> str:
    """All messages by part, each once, those with the same beginning together."""
    found: dict[str, set[str]] = {heading: set() for heading in [*PARTS.values(), OTHERS]}
    for path in sorted(PACKAGE.rglob("*.py")):
        part = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        found[PARTS.get(part, OTHERS)].update(messages(path))
    lines = []
    for heading, texts in found.items():
        lines += [f"## {heading}", ""]
        lines += [f"- {_code(text)}" for text in sorted(texts, key=lambda text: text.lstrip("…: ").lower())]
        lines.append("")
    return "\n".join(lines)


def _code(text: str) -> str:
    fence = "``" if "`" in text else "`"
    return f"{fence}{' '.join(text.split())}{fence}"


def on_page_markdown(markdown: str, **kwargs) -> str:
    """Called by mkdocs for each page."""
    return markdown.replace("<!-- messages -->", table()) if "<!-- messages -->" in markdown else markdown
