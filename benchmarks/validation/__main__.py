"""Problems with known answers: `python -m benchmarks.validation [CARD …]` measures them, draws a figure of each and
writes the page docs/validation.md. `--page` only draws and writes; `--level` 1 to 4 chooses how fine the meshes are."""

import argparse
import sys
import time

import jax


jax.config.update("jax_enable_x64", True)

from ..pages import write  # noqa: E402
from . import page  # noqa: E402


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.validation", description=__doc__)
    parser.add_argument("cards", nargs="*", metavar="CARD", choices=[*page.CARDS, []], help=", ".join(page.CARDS))
    parser.add_argument("--level", type=int, default=3, choices=(1, 2, 3, 4))
    parser.add_argument("--page", action="store_true", help="measure nothing")
    options = parser.parse_args()
    failed = []
    for card in options.cards or page.CARDS:
        started = time.perf_counter()
        if not options.page:
            try:
                figures = []
                for figure in page.module(card).measure(options.level):
                    figures.append(figure)
                    print(
                        f"{card}: {figure.quantity}, {figure.series}, {figure.cells:g}: {figure.error:+.1e}", flush=True
                    )
                page.store(card, figures)
            except RuntimeError as error:
                failed.append(card)
                print(f"{card}: {error}")
            jax.clear_caches()
        page.draw(card)
        print(f"{card}: {time.perf_counter() - started:.0f} s", flush=True)
    write()
    sys.exit(f"failed: {', '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
