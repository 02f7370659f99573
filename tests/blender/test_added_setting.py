# SPDX-License-Identifier: GPL-3.0-or-later
"""A setting is added in one place: all else follows from its declaration."""

import subprocess
import sys
from pathlib import Path


def test_a_declared_setting_is_in_panel_command_keys_and_report(weights: Path, tmp_path: Path) -> None:
    """In a process of its own, where the declaration comes before all that follows from it."""
    command = [sys.executable, "-m", "patchnet.tests.blender.added_setting", str(weights), str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 0 and "found everywhere" in done.stdout, done.stderr
