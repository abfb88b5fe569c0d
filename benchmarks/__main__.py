"""The command line: `python -m benchmarks NAME …` from the root of the repository."""

import argparse
import os
import sys

from . import results, tables
from .case import run
from .questions import NAMES, module


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="+", metavar="NAME", choices=(*NAMES, "all"), help=f"{', '.join(NAMES)}, or all")
    parser.add_argument("--quick", action="store_true", help="small cases only; the results lie apart")
    parser.add_argument("--only", default="", metavar="TEXT", help="only cases so labelled; others are kept")
    parser.add_argument("--list", action="store_true", help="name the cases, and measure none")
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)), help="cores for each case")
    parser.add_argument(
        "--peer-python",
        default=os.environ.get("SHELLKIT_PEER_PYTHON"),
        metavar="PATH",
        help="interpreter with triangulax and optimistix (default: $SHELLKIT_PEER_PYTHON); else none of its cases",
    )
    return parser.parse_args()


def _benchmark(name: str, options: argparse.Namespace) -> bool:
    """Run the cases asked for; each is stored as soon as it is done, among those measured earlier."""
    benchmark = module(name)
    cases = benchmark.cases(options.quick)
    summary = getattr(benchmark, "summary", lambda row, raw: results.compact(row))
    rows = {row["label"]: row for row in results.load(name, options.quick)}
    raw = {} if options.quick else results.load_raw(name)
    measured = []
    for case in cases:
        if options.only not in case.label:
            continue
        print(f"{name}: {case.label}", end="\n" if options.list else " … ", flush=True)
        if options.list:
            continue
        raw[case.label] = row = run(case, options.threads, options.peer_python)
        print(tables.missing(row) or "done", flush=True)
        measured.append(case.label)
        # Of all of this run: what they are compared with may have come last.
        rows |= {label: summary(raw[label], raw) for label in measured}
        results.store(name, [rows[other.label] for other in cases if other.label in rows], options.quick)
        if not options.quick:
            results.store_raw(name, raw)
    if options.quick and measured:
        print(benchmark.page(results.load(name, quick=True)))
    return not any("failed" in rows[label] or rows[label].get("untrue") for label in measured)


def main() -> None:
    options = _options()
    names = NAMES if "all" in options.names else options.names
    sys.exit(0 if all([_benchmark(name, options) for name in names]) else 1)


if __name__ == "__main__":
    main()
