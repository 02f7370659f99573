# SPDX-License-Identifier: GPL-3.0-or-later
"""Ctrl-C and SIGTERM in a real Blender without a window: its own handling ends it."""

import signal
import subprocess
import time
from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import PATIENCE_S, Blender

pytestmark = pytest.mark.usefixtures("ctrl_c")


def batch(scene: Path, line: str) -> tuple[str | Path, ...]:
    return "-b", scene, "--python-exit-code", "1", "--python-expr", f"import bpy; {line}"


def stopped(process: subprocess.Popen[str], at: str, *numbers: signal.Signals) -> str:
    """Send signals two seconds after a line with `at`, and see that the process ends soon; what it then said."""
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
        for number in numbers:
            process.send_signal(number)
            time.sleep(0.1)
        rest, _ = process.communicate(timeout=PATIENCE_S)
        print(f"{numbers[0].name} took {time.monotonic() - start:.1f} s")
    finally:
        process.kill()
    return rest


def test_bake_that_would_take_hours_ends_by_the_second_ctrl_c(installed: Blender, courtyard: Path) -> None:
    tell = "from cycles import engine; bake, calls = engine.bake, []"
    tell += "; told = lambda: print('Cycles bakes', len(calls), flush=True)"
    tell += "; engine.bake = lambda *values: (calls.append(1), told(), bake(*values))"
    endless = "max_samples=65536, noise_threshold=0.0001, cells='everywhere'"
    bake = f"bpy.ops.patchnet.voxelize(depth=5); bpy.ops.patchnet.bake_light({endless})"
    process = installed.start(*batch(courtyard, f"{tell}; {bake}"))
    rest = stopped(process, "Cycles bakes 6", signal.SIGINT, signal.SIGINT)  # the first rounds take a moment each
    assert process.returncode == 2 and "Blender killed" in rest


def test_sigterm_ends_the_command(installed: Blender, courtyard: Path, out: Path) -> None:
    endless = ("--max-samples", "65536", "--noise-threshold", "0.0001", "--light-cells", "everywhere")
    words = ("run", "--depth", "5", *endless, "--cameras", "Far", "--size", "16", "16")
    process = installed.start("-b", courtyard, "--command", "patchnet", *words, "--out", out / "terminated")
    stopped(process, "Baking light", signal.SIGTERM)
    assert process.returncode == -signal.SIGTERM
