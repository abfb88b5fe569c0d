"""What takes long before anything is seen: compilation, once for a kind of scene. A word on it while it lasts, and how
to keep what was compiled."""

import os
import sys
from pathlib import Path

import jax


_WORTH_KEEPING = 0.1  # seconds of compiling below which a program is compiled again


def announce(what: str) -> None:
    """Say on a terminal that something is compiled. To be called where it is traced, which happens only then.

    Nothing is said where the output is no terminal.
    """
    if sys.stderr is not None and sys.stderr.isatty():
        print(f"shellkit: compiling {what}, once …", file=sys.stderr, flush=True)


def keep_compiled(folder: str | os.PathLike | None = None) -> Path:
    """Keep compiled programs on disk, so that the next process does not compile them again: JAX's persistent cache.

    Call it once, at the top of a program, before anything is compiled. It serves all of JAX in this process. What is
    kept depends on the versions of JAX and of the processor; the folder can be deleted at any time.

    **Arguments:**

    - `folder`: where to keep them; made if it is not there. By default `shellkit` in the folder for caches of this
        user, `$XDG_CACHE_HOME` or `~/.cache`.

    **Returns:** the folder.

    **Raises:** `OSError` if the folder cannot be made.

    ??? example

        ```python
        import shellkit as sk

        sk.keep_compiled()
        ```
    """
    if folder is None:
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "shellkit"
    folder = Path(folder).expanduser().absolute()
    folder.mkdir(parents=True, exist_ok=True)
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", _WORTH_KEEPING)
    return folder
