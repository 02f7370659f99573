# SPDX-License-Identifier: GPL-3.0-or-later
"""Ctrl-C and SIGTERM in a real Blender without a window."""

import signal
import subprocess
import time
from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import PATIENCE_S, Blender

pytestmark = pytest.mark.usefixtures("ctrl_c")


def batch(scene: Path, line: str) -> tuple[str | Path, ...]:
    return "-b", scene, "--python-exit-code", "1", "--python-expr", f"import bpy, signal, threading; {line}"


def stopped(process: subprocess.Popen[str], at: str, number: signal.Signals) -> str:
    """Send the signal two seconds after a line with `at`, and see that the process ends soon; what it then said."""
    try:
        assert process.stdout is not None
        said = ""
        while at not in said:
            line = process.stdout.readline()
            assert line, said
            said += line
        time.sleep(2.0)
        assert process.poll() is None
        start = time.monotonic()
        process.send_signal(number)
        rest, _ = process.communicate(timeout=PATIENCE_S)
        print(f"{number.name} took {time.monotonic() - start:.1f} s")
    finally:
        process.kill()
    return rest


def test_bake_that_would_take_hours_ends(installed: Blender, courtyard: Path) -> None:
    tell = "from cycles import engine; bake, calls = engine.bake, []"
    tell += "; told = lambda: print('Cycles bakes', len(calls), flush=True)"
    tell += "; engine.bake = lambda *values: (calls.append(1), told(), bake(*values))"
    endless = "max_samples=65536, noise_threshold=0.0001, cells='everywhere'"
    bake = f"bpy.ops.patchnet.voxelize(depth=5); bpy.ops.patchnet.bake_light({endless})"
    process = installed.start(*batch(courtyard, f"{tell}; {bake}"))
    rest = stopped(process, "Cycles bakes 6", signal.SIGINT)  # the first rounds take a moment each
    assert process.returncode == 128 + signal.SIGINT
    assert "again" in rest and "Traceback" not in rest


def test_sigterm_ends_the_command(installed: Blender, courtyard: Path, out: Path) -> None:
    endless = ("--max-samples", "65536", "--noise-threshold", "0.0001", "--light-cells", "everywhere")
    words = ("run", "--depth", "5", *endless, "--cameras", "Far", "--size", "16", "16")
    process = installed.start("-b", courtyard, "--command", "patchnet", *words, "--out", out / "terminated")
    rest = stopped(process, "Baking light", signal.SIGTERM)
    assert process.returncode == 143
    assert "patchnet: interrupted" in rest and "Traceback" not in rest
    assert not [path.name for path in out.iterdir() if "terminated" in path.name]


def test_steps_of_ours_stop_and_blenders_own_handler_is_back_afterwards(installed: Blender, yard: Path) -> None:
    stopped = "\ntry:\n    bpy.ops.patchnet.voxelize(depth=12)\nexcept RuntimeError as error:\n    print(error)\n"
    again = "signal.raise_signal(signal.SIGINT); print('alive')"
    soon = "threading.Timer(2.0, signal.raise_signal, [signal.SIGINT]).start()"
    done = installed.run(*batch(yard, f"bpy.ops.patchnet.voxelize(depth=4); {soon}{stopped}{again}"))
    assert "Voxelize was stopped: nothing was changed" in done.stdout + done.stderr
    assert "internal break event" in done.stdout and "alive" in done.stdout, done.stdout + done.stderr
