# SPDX-License-Identifier: GPL-3.0-or-later
"""Keys from the window system: Blender's own jobs ignore simulated Esc.

Blender that was started with --enable-event-simulate is deaf to the window system; so these keys are for one without.
"""

import ctypes
from collections.abc import Iterator

ESCAPE = 0xFF1B  # keysym
_PRESS, _RELEASE = 2, 3
_MASKS = {_PRESS: 1, _RELEASE: 2}


class _KeyEvent(ctypes.Structure):
    """XKeyEvent, filled up to the size of an XEvent."""

    _fields_ = [
        ("type", ctypes.c_int), ("serial", ctypes.c_ulong), ("send_event", ctypes.c_int),
        ("display", ctypes.c_void_p), ("window", ctypes.c_ulong), ("root", ctypes.c_ulong),
        ("subwindow", ctypes.c_ulong), ("time", ctypes.c_ulong), ("x", ctypes.c_int), ("y", ctypes.c_int),
        ("x_root", ctypes.c_int), ("y_root", ctypes.c_int), ("state", ctypes.c_uint), ("keycode", ctypes.c_uint),
        ("same_screen", ctypes.c_int), ("fill", ctypes.c_long * 24),
    ]  # fmt: skip


def press(keysym: int) -> int:
    """Press and release a key over every window of the screen; how many windows there are."""
    x11 = ctypes.CDLL("libX11.so.6")
    x11.XOpenDisplay.restype = ctypes.c_void_p
    x11.XDefaultRootWindow.restype = ctypes.c_ulong
    x11.XKeysymToKeycode.restype = ctypes.c_ubyte
    display = ctypes.c_void_p(x11.XOpenDisplay(None))
    if not display:
        raise RuntimeError("no display")
    try:
        root = x11.XDefaultRootWindow(display)
        code = x11.XKeysymToKeycode(display, ctypes.c_ulong(keysym))
        windows = list(_children(x11, display, root))
        for window in windows:
            for kind in (_PRESS, _RELEASE):
                event = _KeyEvent(
                    type=kind, display=display, window=window, root=root, x=5, y=5, keycode=code, same_screen=1
                )
                x11.XSendEvent(display, ctypes.c_ulong(window), 0, ctypes.c_long(_MASKS[kind]), ctypes.byref(event))
        x11.XSync(display, 0)
        return len(windows)
    finally:
        x11.XCloseDisplay(display)


def _children(x11: ctypes.CDLL, display: ctypes.c_void_p, window: int) -> Iterator[int]:
    """All windows below one."""
    root, parent = ctypes.c_ulong(), ctypes.c_ulong()
    found, count = ctypes.POINTER(ctypes.c_ulong)(), ctypes.c_uint()
    x11.XQueryTree(
        display, ctypes.c_ulong(window), ctypes.byref(root), ctypes.byref(parent),
        ctypes.byref(found), ctypes.byref(count),
    )  # fmt: skip
    below = [found[index] for index in range(count.value)]
    if below:
        x11.XFree(found)
    for item in below:
        yield item
        yield from _children(x11, display, item)
