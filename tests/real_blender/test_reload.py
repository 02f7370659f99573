# SPDX-License-Identifier: GPL-3.0-or-later
"""Check the reports of reload_window.py: octrees survive a killed Blender."""

from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import Blender

BAKED = "Baking light"


TELL = (
    "from cycles import engine; bake = engine.bake"
    "; engine.bake = lambda *values: (print('Cycles bakes', values[2].name, flush=True), bake(*values))"
)
SAME = ("--depth", "6", "--size", "96", "64", "--cameras", "Far", "--max-samples", "2")  # as in reload_window.py


@pytest.fixture(scope="module")
def keeping(installed: Blender) -> Blender:
    """Blender that keeps octrees."""
    return Blender(installed.prefix, installed.program, installed.environment | {"PATCHNET_KEEP": "1"})


@pytest.fixture(scope="module")
def visits(keeping: Blender, yard: Path, out: Path) -> tuple[dict, dict]:
    """Reports from before Blender died, and after the file was opened."""
    died = keeping.visit("made", out, "made", file=yard, script="reload", ended="stopped after made")
    assert BAKED in died["steps"]
    return died, keeping.visit("opened", out, "opened", file=out / "reload.blend", script="reload")


def test_voxels_and_codes_come_back_and_fit(visits: tuple[dict, dict]) -> None:
    died, opened = visits
    assert died["told"]["codes"] > 100 and died["told"]["stale"] == []
    assert opened["told"] == opened["told when reverted"] == died["told"]


def test_pictures_come_back_with_render_preview(visits: tuple[dict, dict]) -> None:
    _, opened = visits
    assert opened["pictures at first"] == [] and opened["pictures"] == 11
    assert opened["steps of the preview"] and BAKED not in opened["steps of the preview"]


def test_renders_take_them_without_a_bake(visits: tuple[dict, dict]) -> None:
    _, opened = visits
    assert opened["render"] == {"ended": ["complete"], "same voxels": True}


def test_another_frame_of_what_only_could_move_changes_nothing(visits: tuple[dict, dict]) -> None:
    _, opened = visits
    assert opened["told at another frame"] == opened["told"]
    assert BAKED not in opened["steps at another frame"] and "Voxelizing" not in opened["steps at another frame"]


@pytest.mark.parametrize(
    "words",
    [
        ("-f", "1"),
        ("-f", "3"),
        ("-s", "2", "-e", "3", "-a"),
        ("--command", "patchnet", "run", "--out", "{out}/run", *SAME),
        ("--command", "patchnet", "run", "--out", "{out}/frames", "--frames", "1,3", *SAME),
    ],
    ids=lambda words: " ".join(words[:3]) + (" frames" if "--frames" in words else ""),
)
def test_no_process_bakes_again(visits: tuple[dict, dict], keeping: Blender, out: Path, words: tuple[str, ...]) -> None:
    small = "; import bpy; r = bpy.context.scene.render; r.resolution_x, r.resolution_y, r.engine = 96, 64, 'PATCHNET'"
    words = tuple(word.format(out=out) for word in words)
    file, prepare = out / "reload.blend", ("--python-exit-code", "1", "--python-expr", TELL + small)
    done = keeping.run("-b", file, *prepare, "-o", out / "again" / "####", *words)
    said = done.stdout + done.stderr
    assert done.returncode == 0 and "Traceback" not in said, said
    baked = [line for line in said.splitlines() if line.startswith("Cycles bakes")]
    assert set(baked) <= {"Cycles bakes PatchNet World"} and "Voxelizing" not in said, said  # what is behind the voxels
