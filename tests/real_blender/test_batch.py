# SPDX-License-Identifier: GPL-3.0-or-later
"""A real Blender without a window: the extension installs cleanly, and the batch line of the README does the job."""

import json
from pathlib import Path

from patchnet.tests.real_blender.executable import Blender

PICTURES = {"preview.png", "heatmap.png", "overlay.png", "priority.exr", "refined.png", "reference.png", "error.png"}


def batch(blender: Blender, scene: Path, arguments: str):
    """`blender -b SCENE --python-expr ...`, in the order that Blender wants."""
    line = f"import bpy; bpy.ops.patchnet.run_all({arguments})"
    return blender.run("-b", scene, "--python-exit-code", "1", "--python-expr", line)


def test_blender_has_no_complaints_about_the_extension(installed: Blender) -> None:
    warnings = "addon_utils._extensions_warnings_get().items()"
    assert installed.value(f"[text for name, text in {warnings} if 'patchnet' in name]") == "[]"


def test_batch_line_writes_pictures_and_report(installed: Blender, courtyard: Path, out: Path) -> None:
    done = batch(installed, courtyard, "depth=6, samples=1, cameras='Far', size=(48, 32), out='//batch'")
    assert done.returncode == 0 and "Traceback" not in done.stdout + done.stderr, done.stdout + done.stderr
    report = json.loads((out / "batch" / "report.json").read_text())
    assert report["octree"]["depth"] == 6
    (frame,) = report["frames"]
    assert frame["camera"] == "Far" and frame["mse"]["optimal"] <= frame["mse_unrefined"]
    assert {path.name for path in (out / "batch" / "Far").iterdir()} == PICTURES


def test_bad_input_is_an_exit_code_and_a_sentence(installed: Blender, courtyard: Path, out: Path) -> None:
    done = batch(installed, courtyard, "depth=6, cameras='Nobody', out='//bad'")
    assert done.returncode == 1
    assert "Nobody" in done.stdout + done.stderr
    assert not (out / "bad").exists()
