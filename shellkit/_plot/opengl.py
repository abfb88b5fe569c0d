"""Whether and where a picture can be drawn. Without OpenGL, VTK ends the process with a segmentation fault, so this is
asked first."""

import ctypes.util
import functools
import os
import sys


def has_display() -> bool:
    """Whether there is a screen that a window could open on."""
    if not sys.platform.startswith("linux"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


@functools.cache
def require_opengl() -> None:
    """Raise a `RuntimeError` that says what to install if VTK finds no OpenGL to draw with."""
    if not has_display():
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401 (registers the kinds of window)
    from vtkmodules.vtkRenderingCore import vtkRenderWindow

    # VTK tries what the platform has and ends at OSMesa, without looking whether that is there.
    last_resort = type(vtkRenderWindow()).__name__ == "vtkOSOpenGLRenderWindow"
    if last_resort and ctypes.util.find_library("OSMesa") is None:
        raise RuntimeError(
            "plot: no OpenGL was found to draw with, neither on a screen nor without one. On Debian or Ubuntu install "
            "it with: apt-get install libegl1 libgl1-mesa-dri. (VTK_DEFAULT_OPENGL_WINDOW is "
            f"{os.environ.get('VTK_DEFAULT_OPENGL_WINDOW', 'not set')!r}; vtkEGLRenderWindow draws without a screen.)"
        )
