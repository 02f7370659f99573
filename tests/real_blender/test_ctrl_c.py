# SPDX-License-Identifier: GPL-3.0-or-later
"""Ctrl-C in a real Blender without a window, which has a handler of its own that Python does not know."""

import signal
import time
from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import Blender

pytestmark = pytest.mark.usefixtures("ctrl_c")

# The longest that a stop may take by the project's rule, three times: machines that test do other things too.
PATIENCE_S = 15.0


def batch(scene: Path, line: str) -> tuple[str | Path, ...]:
    return "-b", scene, "--python-exit-code", "1", "--python-expr", f"import bpy, signal, threading; {line}"


def test_bake_that_would_take_hours_ends(installed: Blender, courtyard: Path) -> None:
    tell = "from cycles import engine; bake = engine.bake"
    tell += "; engine.bake = lambda *values: (print('Cycles bakes', flush=True), bake(*values))"
    bake = "bpy.ops.patchnet.voxelize(depth=5); bpy.ops.patchnet.bake_light(light='cycles', samples=65536)"
    process = installed.start(*batch(courtyard, f"{tell}; {bake}"))
    try:
        assert process.stdout is not None
        said = ""
        while "Cycles bakes" not in said:
            line = process.stdout.readline()
            assert line, said
            said += line
        time.sleep(2.0)
        assert process.poll() is None
        start = time.monotonic()
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=PATIENCE_S)
        print(f"Ctrl-C took {time.monotonic() - start:.1f} s")
    finally:
        process.kill()
    assert process.returncode == 130
    assert "goes on where it was" in rest


def test_steps_of_ours_stop_and_say_so(installed: Blender, courtyard: Path) -> None:
    soon = "threading.Timer(2.0, signal.raise_signal, [signal.SIGINT]).start()"
    done = installed.run(
        *batch(courtyard, f"bpy.ops.patchnet.voxelize(depth=4); {soon}; bpy.ops.patchnet.voxelize(depth=12)")
    )
    assert done.returncode == 1
    assert "Voxelize was stopped: nothing was changed" in done.stdout + done.stderr


def test_blenders_own_handler_is_back_afterwards(installed: Blender, courtyard: Path) -> None:
    again = "signal.raise_signal(signal.SIGINT); print('alive')"
    done = installed.run(*batch(courtyard, f"bpy.ops.patchnet.voxelize(depth=4); {again}"))
    assert "internal break event" in done.stdout and "alive" in done.stdout, done.stdout + done.stderr
