# SPDX-License-Identifier: GPL-3.0-or-later
"""A real Blender without a window: a clean install, the batch lines of README and docs."""

import json
from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import Blender

QUICK = ("--depth", "5", "--light", "two-lights", "--cameras", "Camera", "--size", "16", "16")
PICTURES = {
    "preview.png", "predicted.png", "heatmap.png", "overlay.png", "priority.exr", "refined.png", "reference.png",
    "error.png",
}  # fmt: skip
UNFREED = "Not freed memory blocks"  # what Blender says at its exit


def batch(blender: Blender, scene: Path, arguments: str):
    """`blender -b SCENE --python-expr ...`, in the order that Blender wants."""
    line = f"import bpy; bpy.ops.patchnet.run_all({arguments})"
    return blender.run("-b", scene, "--python-exit-code", "1", "--python-expr", line)


def test_blender_has_no_complaints_about_the_extension(installed: Blender) -> None:
    warnings = "addon_utils._extensions_warnings_get().items()"
    assert installed.value(f"[text for name, text in {warnings} if 'patchnet' in name]") == "[]"


def test_batch_line_writes_pictures_and_report(installed: Blender, yard: Path, out: Path) -> None:
    done = batch(installed, yard, "depth=6, max_samples=2, cameras='Far', size=(48, 32), reference=True, out='//batch'")
    assert done.returncode == 0 and "Traceback" not in done.stdout + done.stderr, done.stdout + done.stderr
    report = json.loads((out / "batch" / "report.json").read_text())
    assert report["octree"]["depth"] == 6
    (frame,) = report["frames"]
    assert frame["camera"] == "Far" and frame["mse"]["optimal"] <= frame["mse_unrefined"]
    assert {path.name for path in (out / "batch" / "Far").iterdir()} == PICTURES
    assert UNFREED not in done.stdout + done.stderr


@pytest.fixture(scope="module")
def cube(installed: Blender, out: Path) -> Path:
    """Blender's own first scene. In the courtyard, UVs of the basin differ between two starts now and then."""
    path = out / "cube.blend"
    installed.execute(f"import bpy; bpy.ops.wm.save_as_mainfile(filepath={str(path)!r})")
    return path


def test_command_on_the_open_file(installed: Blender, cube: Path, out: Path) -> None:
    words = ("-b", cube, "--command", "patchnet", "run", "--out", "//command", "--frames", "2,3", *QUICK)
    done = installed.run(*words, "--log-format", "json")
    assert done.returncode == 0, done.stdout + done.stderr
    said = [json.loads(line) for line in done.stderr.splitlines() if line.startswith("{")]
    assert UNFREED not in done.stdout + done.stderr
    assert said[0]["event"] == "start" and said[-1]["event"] == "result" and said[-1]["made"] == [2, 3]
    assert json.loads((out / "command" / "report.json").read_text())["complete"]
    again = installed.run(*words)
    assert again.returncode == 0 and "0 frames made, 2 were there" in again.stdout
    assert installed.run("--command", "patchnet", "info", out / "command/frame-0002/octree.safetensors").returncode == 0


def test_octree_and_export_in_blender(installed: Blender, cube: Path, out: Path) -> None:
    octree, points = out / "command" / "cube.safetensors", out / "command" / "cube.ply"
    made = installed.run("-b", cube, "--command", "patchnet", "octree", "--out", octree, *QUICK[:4])
    assert made.returncode == 0 and "cube.safetensors: depth 5" in made.stdout, made.stdout + made.stderr
    exported = installed.run("--command", "patchnet", "export", octree, "--out", points)
    assert exported.returncode == 0 and points.read_bytes().startswith(b"ply\n"), exported.stdout + exported.stderr


SMALL = (
    "import bpy; s = bpy.context.scene; s.patchnet.max_samples = 2"
    "; s.render.resolution_x, s.render.resolution_y = 48, 32"
)
MOVED = (
    "o = s.objects['Cube']; [o.keyframe_insert('location', frame=f) for f in (1, 3) if not setattr(o.location, 'x', f)]"
)


@pytest.mark.parametrize("change", ["", MOVED], ids=["still", "moved"])
def test_animation_is_rendered_to_its_last_frame(installed: Blender, cube: Path, out: Path, change: str) -> None:
    """Every frame that bakes inside the render, the next one after it too, as `-a` and as the operator."""
    pictures = out / f"animation{len(change)}"
    range_of_frames = ("-o", pictures / "a_", "-s", "1", "-e", "3")
    prepare = ("-b", cube, "--python-exit-code", "1", "--python-expr", f"{SMALL}; {change or 'pass'}")
    again = f"s.render.filepath = {str(pictures / 'b_')!r}; bpy.ops.render.render(animation=True)"
    rest = ("--python-expr", f"import bpy; s = bpy.context.scene; {again}")
    done = installed.run(*prepare, "-E", "PATCHNET", *range_of_frames, "-a", *rest)
    assert done.returncode == 0 and "Traceback" not in done.stdout + done.stderr, done.stdout[-2000:] + done.stderr
    assert UNFREED not in done.stdout + done.stderr
    assert sorted(path.stem for path in pictures.iterdir()) == [
        f"{name}_000{frame}" for name in "ab" for frame in (1, 2, 3)
    ]
