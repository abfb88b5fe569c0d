"""Whole jobs, each a program of its own as a user would write it: `python -m benchmarks.jobs.NAME MESH STEPS` designs
the ellipsoid of the tutorial and says when what is done, in lines of JSON with the time of day."""

import json
import time


def mark(what: str) -> None:
    """Say that this is done, now."""
    print(json.dumps({"mark": what, "time": time.time()}), flush=True)
