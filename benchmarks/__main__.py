"""The command line: `python -m benchmarks NAME …` from the root of the repository."""

import argparse
import importlib
import os
import sys

from . import report
from .case import run


NAMES = (
    "whole_job",
    "design_step",
    "relaxation",
    "head_fields",
    "scaling",
    "gradient_cost",
    "energy_kernel",
    "pricing",
    "training",
    "surface_losses",
    "platforms",
    "accuracy",
)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="+", metavar="NAME", choices=(*NAMES, "all"), help=f"{', '.join(NAMES)}, or all")
    parser.add_argument("--quick", action="store_true", help="small cases only; the results lie apart")
    parser.add_argument("--only", default="", metavar="TEXT", help="only cases so labelled; others are kept")
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
    benchmark = importlib.import_module(f"benchmarks.{name}")
    cases = benchmark.cases(options.quick)
    known = {row["label"]: row for row in report.load(name, options.quick)}
    fine = True
    for case in cases:
        if options.only in case.label:
            print(f"{name}: {case.label} …", end=" ", flush=True)
            known[case.label] = row = run(case, options.threads, options.peer_python)
            print(report.missing(row) or "done", flush=True)
            fine = fine and "failed" not in row
            rows = [known[other.label] for other in cases if other.label in known]
            report.store(name, options.quick, rows, benchmark.page)
    return fine


def main() -> None:
    options = _options()
    names = NAMES if "all" in options.names else options.names
    sys.exit(0 if all([_benchmark(name, options) for name in names]) else 1)


if __name__ == "__main__":
    main()
