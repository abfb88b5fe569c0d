"""The one check of the floating-point width. Thin shells need float64: the condition number of a shell's Hessian grows
with the square of length over thickness, beyond what float32 can hold."""

import jax


def require_x64(what: str) -> None:
    """Raises a `RuntimeError` unless JAX computes in double precision.

    **Arguments:**

    - `what`: what needs it, to begin the message with: `"a Mesh"`.
    """
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            f"{what} needs double precision, which JAX has switched off: call "
            "jax.config.update('jax_enable_x64', True) first, before any array is made "
            "(or set the environment variable JAX_ENABLE_X64=1)."
        )
