# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated input in a Blender window: moves, clicks, keys, search for buttons, screenshots.

A session is a generator that yields to let the window work: `yield seconds`, or `yield from wait_for(condition, ...)`.
"""

import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Generator
from pathlib import Path

import bpy

Session = Generator[float, None, None]
_MOMENT_S = 0.05  # enough for the window to handle an event and to draw
_MOVED_PX = 80
_ROW_STEP_PX = 16  # less than the height of a button


def play(session: Session, at_end: Callable[[str], None]) -> None:
    """Run the session beside the window's own work; `at_end` gets the traceback of what went wrong, or ""."""

    def tick() -> float | None:
        try:
            return next(session)
        except StopIteration:
            at_end("")
        except BaseException:
            at_end(traceback.format_exc())
            raise
        return None

    bpy.app.timers.register(tick, first_interval=1.0, persistent=True)


def wait_for(condition: Callable[[], bool], what: str, seconds: float = 60.0) -> Session:
    """Let the window work until `condition` holds; raises TimeoutError that says what did not happen."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError(f"not within {seconds:.0f} s: {what}")
        yield _MOMENT_S


def window() -> bpy.types.Window:
    """The only window there is."""
    return bpy.context.window_manager.windows[0]


def area(kind: str) -> bpy.types.Area:
    """The largest area of a kind, such as VIEW_3D."""
    found = [item for item in window().screen.areas if item.type == kind]
    return max(found, key=lambda item: item.width * item.height)


def region(kind: str, of: str = "VIEW_3D") -> bpy.types.Region:
    """A region of the largest area of a kind."""
    return next(item for item in area(of).regions if item.type == kind)


def move(x: int, y: int) -> Session:
    """Move the mouse, in window pixels from the lower left."""
    window().event_simulate(type="MOUSEMOVE", value="NOTHING", x=x, y=y)
    yield _MOMENT_S


def key(name: str, x: int, y: int, *, ctrl: bool = False) -> Session:
    """Press and release a key or a mouse button over a point."""
    for value in ("PRESS", "RELEASE"):
        window().event_simulate(type=name, value=value, x=x, y=y, ctrl=ctrl)
    yield _MOMENT_S


def over_viewport() -> tuple[int, int]:
    """A point of the 3D viewport far from its toolbars."""
    pane = region("WINDOW")
    return pane.x + pane.width // 3, pane.y + pane.height // 4


def scroll(kind: str, wheel: str = "WHEELDOWNMOUSE", notches: int = 30) -> Session:
    """Turn the wheel over a region of the viewport, to its end if there are enough notches."""
    pane = region(kind)
    x, y = pane.x + pane.width // 2, pane.y + pane.height // 2
    yield from move(x, y)
    for _ in range(notches):
        window().event_simulate(type=wheel, value="PRESS", x=x, y=y)
        yield _MOMENT_S


def find_buttons(wanted: set[str], *, upwards: bool = False) -> Generator[float, None, dict[str, tuple[int, int]]]:
    """Points of the operator buttons in the sidebar, by identifier, until all `wanted` are found or the sidebar ends.

    upwards: look from its lower end.

    Blender has no list of its buttons, but Ctrl+C over one copies the Python call that it makes.
    """
    side = region("UI")
    x = side.x + side.width // 2
    found: dict[str, tuple[int, int]] = {}
    rows = range(side.y + side.height - 12, side.y + 8, -_ROW_STEP_PX)
    for y in reversed(rows) if upwards else rows:
        name = yield from _button_at(x, y)
        if name:
            found.setdefault(name, (x, y))
        if wanted <= set(found):
            break
    return found


def find_again(name: str, point: tuple[int, int]) -> Generator[float, None, tuple[int, int]]:
    """Find a button that was at a point: lines that panels got or lost meanwhile move it, also out of sight."""
    x, y = point
    side = region("UI")
    for distance in range(0, _MOVED_PX, _ROW_STEP_PX):
        for place in (y - distance, y + distance):
            if not 8 < place - side.y < side.height:  # Ctrl+C over the timeline opens a report that takes the wheel
                continue
            if (yield from _button_at(x, place)) == name:
                return x, place
    for wheel, notches in [("WHEELDOWNMOUSE", 5), ("WHEELUPMOUSE", 40), *[("WHEELDOWNMOUSE", 5)] * 6]:
        yield from scroll("UI", wheel, notches)
        found = yield from find_buttons({name})
        if name in found:
            return found[name]
    raise RuntimeError(f"The button {name} is not in the sidebar")


def _button_at(x: int, y: int) -> Generator[float, None, str]:
    """Identifier of the operator whose button is at a point, or nothing."""
    bpy.context.window_manager.clipboard = ""
    yield from move(x, y)
    yield from key("C", x, y, ctrl=True)
    text = bpy.context.window_manager.clipboard
    return text.removeprefix("bpy.ops.").partition("(")[0] if text.startswith("bpy.ops.") else ""


def click(point: tuple[int, int]) -> Session:
    """Click with the left button, then take the mouse away so that no tooltip appears."""
    yield from move(*point)
    yield from key("LEFTMOUSE", *point)
    yield from move(*over_viewport())


def dismiss() -> Session:
    """Close a message that popped up: Esc, and the mouse far away from it."""
    x, y = over_viewport()
    yield from key("ESC", x, y)
    yield from move(x + 300, y + 400)
    yield 0.5
    yield from move(x, y)


def screenshot(path: Path, box: tuple[int, int, int, int] | None = None) -> Session:
    """Save what the screen shows, or a box (x, y, width, height) of it in window pixels from the lower left."""
    for pane in window().screen.areas:
        pane.tag_redraw()
    yield 0.3
    crop = []
    if box:
        x, y, width, height = box
        crop = ["-crop", f"{width}x{height}+{x}+{window().height - y - height}", "+repage"]
    done = subprocess.run(["import", "-window", "root", *crop, str(path)], capture_output=True, text=True, check=False)
    if done.returncode:
        print(f"no screenshot: {done.stderr}", file=sys.stderr)
    yield _MOMENT_S
