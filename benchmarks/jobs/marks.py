"""How a job says that it has come so far: a line of JSON with the time of day."""

import json
import time


def mark(what: str) -> None:
    """Say that this is done, now."""
    print(json.dumps({"mark": what, "time": time.time()}), flush=True)
