# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's process in a whole session, and in commands: no thread, no compiler, no other imports or signals."""

import json
from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import Blender

# Blender with a window, without any extension, once it has drawn: the graphics library has signals too.
PLAIN = """
import bpy, json, os, signal, sys

def tell():
    valid = [number for number in sorted(signal.valid_signals()) if isinstance(number, signal.Signals)]
    handlers = [f"{number.name}: {signal.getsignal(number)}" for number in valid]
    print("plain:", json.dumps([sys.path, handlers]), flush=True)
    os._exit(0)

bpy.app.timers.register(tell, first_interval=2.0)
"""


@pytest.fixture(scope="module")
def seen(installed: Blender, yard: Path, out: Path) -> dict:
    """Report of session_window.py."""
    return installed.visit("session", out, file=yard)


def test_no_thread_of_ours_runs(seen: dict) -> None:
    """Renders have threads of Blender's, which Python knows as dummies once they run Python."""
    assert seen["told"] == ["1 view"] and seen["rendered"] == ["complete"]
    assert set(seen["threads"]) <= {"_MainThread MainThread", "_DummyThread Dummy"}


def test_no_kernels_are_imported(seen: dict) -> None:
    assert seen["engine"] and seen["own modules"] > 150
    assert seen["compilers"] == [] == seen["kernels"]


def test_imports_and_signals_are_as_without_the_extension(seen: dict, installed: Blender, out: Path) -> None:
    assert seen["path"]["changed"] == [] == seen["signals"]["changed"]
    folder = out / "plain"
    folder.mkdir()
    blender = Blender(installed.prefix, installed.program, {"BLENDER_USER_RESOURCES": str(folder)})
    blender.execute("import bpy; bpy.ops.wm.save_userpref()")  # reading it sets a signal
    said = blender.run_window("--python-expr", PLAIN).stdout.splitlines()
    path, signals = json.loads(next(line for line in said if line.startswith("plain: ")).removeprefix("plain: "))
    assert seen["signals"]["at start"] == signals
    path = [name.replace(str(folder), str(out / "resources")) for name in path]
    more = [name for name in seen["path"]["at start"] if name not in path]
    assert all(".local/lib/python" in name for name in more), "Blender's folder for the wheels of all extensions"
