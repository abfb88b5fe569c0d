"""Hard cases, many of each kind: `python -m benchmarks.stability` relaxes them, judges each, and writes the page.

It fails if anything is not finite, or if a relaxation claims to have converged where it has not.
"""

import argparse
import sys

import jax


jax.config.update("jax_enable_x64", True)

from ..pages import write  # noqa: E402
from . import page  # noqa: E402
from .cases import KINDS, MATERIALS  # noqa: E402
from .verdict import judge  # noqa: E402


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.stability", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a few cases of each kind; the page stays as it is")
    quick = parser.parse_args().quick
    verdicts = []
    for material in MATERIALS:
        for kind, (cases, count) in KINDS.items():
            for case in cases(material, min(count, 4) if quick else count):
                verdict = judge(case)
                verdicts.append((material, kind, verdict))
                print(f"{material}: {kind}: {verdict.label}: {verdict.reason or 'converged'}", flush=True)
    bad = [f"{kind}: {v.label}" for _, kind, v in verdicts if not (v.finite and v.honest)]
    if not quick:
        page.store(verdicts)
        write()
    sys.exit(f"not finite, or not true: {', '.join(bad)}" if bad else 0)


if __name__ == "__main__":
    main()
