"""Runs the examples and shows them on docs/gallery.md: `python -m docs.gallery` runs those without stored results, with
names it runs these again. What a run printed, took and drew lies in docs/assets/gallery; `--check` runs nothing."""

import argparse
import ast
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from PIL import Image, ImageSequence

from benchmarks.conditions import describe
from benchmarks.pages import write


ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "docs" / "assets" / "gallery"
WIDEST = 1200  # pixels
LARGEST = 140_000  # bytes

# Which runs stand on the pages, where it is not the one without arguments. The pictures are those of the last.
ARGUMENTS = {
    "ellipsoid": ("", "--subdivisions 3"),
    "sphere_to_suzanne": ("--levels 3 --steps 60",),
}


def examples() -> list[str]:
    """The names of all examples."""
    return sorted(path.stem for path in (ROOT / "examples").glob("*.py"))


def stored() -> dict[str, list[dict[str, Any]]]:
    """The runs of each example that has been run."""
    names = [name for name in examples() if (RESULTS / f"{name}.json").exists()]
    return {name: json.loads((RESULTS / f"{name}.json").read_text())["runs"] for name in names}


def run(name: str) -> None:
    """Runs an example and stores what it printed, what it took, and its pictures made small."""
    RESULTS.mkdir(parents=True, exist_ok=True)
    runs, pictures = [], []
    with tempfile.TemporaryDirectory() as folder:
        for arguments in ARGUMENTS.get(name, ("",)):
            record = _run(name, arguments, Path(folder) / name)
            runs.append(record)
        for old in RESULTS.glob(f"{name}.*.*"):
            old.unlink()
        drawn = [path for path in (Path(folder) / name).iterdir() if path.suffix in (".png", ".gif")]
        for path in sorted(drawn, key=lambda path: ("history" in path.stem, path.stem != name, path.name)):
            pictures.append(_small(path, RESULTS / f"{name}.{path.stem}.webp"))
    runs[-1]["pictures"] = pictures
    (RESULTS / f"{name}.json").write_text(json.dumps({"runs": runs}, indent=1, ensure_ascii=False) + "\n")


def _run(name: str, arguments: str, out: Path) -> dict[str, Any]:
    command = [sys.executable, f"examples/{name}.py", *arguments.split(), "--out", str(out)]
    # Times hold what anyone pays on a first run.
    env = os.environ | {"PYTHONPATH": str(ROOT), "JAX_ENABLE_COMPILATION_CACHE": "false"}
    begun, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=env)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(f"{' '.join(command)}\n{done.stderr}")
    machine = describe()
    return {
        "arguments": arguments,
        "output": done.stdout.replace(str(out), f"out/{name}").rstrip(),
        "seconds": round(time.perf_counter() - begun, 1),
        "processor_seconds": round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, 1),
        "machine": f"{machine['cpu']}, {machine['cores']} cores",
        "date": datetime.now(UTC).date().isoformat(),
    }


def _small(path: Path, place: Path) -> dict[str, Any]:
    """Writes a picture or a film as webp, no wider than a page, and narrower still if it is large."""
    image = Image.open(path)
    width, every = min(800 if "history" in path.stem else WIDEST, image.width), 1
    while True:
        size = (width, round(image.height * width / image.width))
        frames = [frame.convert("RGB") for frame in ImageSequence.Iterator(image)][::every]
        first, *others = (frame.resize(size, Image.Resampling.LANCZOS) for frame in frames)
        film = {"save_all": True, "append_images": others, "loop": 0} if others else {}
        duration = {"duration": every * image.info.get("duration", 100)} if others else {}
        first.save(place, quality=88, method=6, **film, **duration)
        if place.stat().st_size <= LARGEST:
            return {"file": place.name, "width": size[0], "height": size[1]}
        width, every = round(0.85 * width), every + (bool(others) and every < 3)


def content() -> str:
    """All examples that have been run, each with its pictures, its figures, its run time and its script."""
    return "\n\n".join(_section(name, runs) for name, runs in stored().items())


def _section(name: str, runs: list[dict[str, Any]]) -> str:
    words = " ".join((ast.get_docstring(ast.parse((ROOT / f"examples/{name}.py").read_text())) or name).split())
    title, rest = re.match(r"([^:.,]*)[:.,]? ?(.*)", words).groups()
    parts = [f"## {title}"]
    parts += [f"{rest[:1].upper()}{rest[1:]}"] if rest else []
    parts += [_picture(title, picture) for picture in runs[-1]["pictures"]]
    parts += [printed(name, number) for number in range(len(runs))]
    script = f"examples/{name}.py"
    parts.append(f'??? example "The script: {script}"\n\n    ```{{ .python }}\n    --8<-- "{script}"\n    ```')
    return "\n\n".join(parts)


def _picture(title: str, picture: dict[str, Any]) -> str:
    what = picture["file"].rpartition(".")[0].partition(".")[2].replace("_", " ")
    width = picture["width"] if picture["width"] > 800 else min(picture["width"], 480)
    return f'![{title}: {what}](assets/gallery/{picture["file"]}){{ width="{width}" loading="lazy" }}'


def printed(name: str, number: int = 0) -> str:
    """What a stored run printed, under its command, and what it took."""
    runs = stored().get(name, [])
    if number >= len(runs):
        return f"*Not run yet: `python -m docs.gallery {name}`.*"
    record = runs[number]
    command = f"python examples/{name}.py {record['arguments']}".rstrip()
    return (
        f"```text\n$ {command}\n{record['output']}\n```\n\n*{_time(record['processor_seconds'])} of a processor, "
        f"compilation and drawing included, in {_time(record['seconds'])}: {record['machine']}; "
        f"{record['date']}.*"
    )


def _time(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


PAGES = {
    "docs/gallery.md": {"gallery": content},
    "docs/tutorial.md": {
        "teacher": lambda: printed("teacher"),
        "ellipsoid": lambda: printed("ellipsoid"),
        "ellipsoid-fine": lambda: printed("ellipsoid", 1),
        "suzanne": lambda: printed("suzanne"),
    },
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="examples to run again")
    parser.add_argument("--page", action="store_true", help="run nothing, only write the pages")
    parser.add_argument("--check", action="store_true", help="run nothing, only say whether a page is out of date")
    options = parser.parse_args()
    if not (options.page or options.check):
        for name in options.names or [name for name in examples() if name not in stored()]:
            run(name)
            print(name, *(f"{record['seconds']} s" for record in stored()[name]))
    stale = write(PAGES, options.check)
    print("\n".join(stale) or "up to date")
    sys.exit(1 if options.check and stale else 0)


if __name__ == "__main__":
    main()
