"""A word on what takes long before anything is seen: compilation, once for a kind of scene."""

import sys


def announce(what: str) -> None:
    """Say on a terminal that something is compiled. To be called where it is traced, which happens only then.

    Nothing is said where the output is no terminal.
    """
    if sys.stderr is not None and sys.stderr.isatty():
        print(f"shellkit: compiling {what}, once …", file=sys.stderr, flush=True)
