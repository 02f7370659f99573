# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands and operators refuse to replace inputs or foreign files, before they begin."""

from collections.abc import Iterator
from pathlib import Path

import bpy
import pytest

from patchnet.tests.blender.job_scene import QUICK, build, saved
from patchnet.training import commands

STAGES = ("Reading", "Finding", "Voxelizing", "Drawing", "Writing", "Looking")
OCTREE = ["--depth", "4", "--light", "two-lights"]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene, an octree of it, the same under other names, and things that are not ours."""
    folder = tmp_path_factory.mktemp("files")
    build()
    scene = saved(folder / "small.blend")
    octree = folder / "octree.safetensors"
    assert commands.main(["octree", str(scene), *OCTREE, "--out", str(octree)]) == 0
    (folder / "link.safetensors").symlink_to(octree)
    (folder / "mesh.ply").write_text("a list of mine")
    foreign = {
        "report": "report.json", "octree": "octree.safetensors", "frame": "frame-0001/report.json",
        "picture": "Eye/preview.png", "samples": "octree.samples.safetensors", "weights": "patchnet.safetensors",
        "log": "log.jsonl", "scene": "courtyard.blend", "overview": "overview.png", "record": "frame-0002/frame.json",
    }  # fmt: skip
    for name, path in foreign.items():
        (folder / name / path).parent.mkdir(parents=True)
        (folder / name / path).write_text('{"mine": 1}')
    (folder / "camera").mkdir()
    (folder / "camera" / "Eye").write_text("a file where a folder belongs")
    return folder


def everything(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture
def unchanged(files: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Nothing in the folder is other than before, and no file is new."""
    monkeypatch.chdir(files)
    before = everything(files)
    yield
    assert everything(files) == before


RUN = ["run", "small.blend", *QUICK]
# Of each command; tests/engine/test_outputs.py has the rules: links, folders, other files in the way.
READ, FOREIGN, WAY = "and would be replaced", "is not replaced", "is a file, and"
REFUSED: dict[str, tuple[list[str], str]] = {
    "octree over its scene": (["octree", "small.blend", *OCTREE, "--out", "small.blend"], READ),
    "run --frames over a frame": ([*RUN, "--frames", "1-2", "--out", "record"], FOREIGN),
    "export over its octree": (["export", "octree.safetensors", "--level", "3", "--out", "octree.safetensors"], READ),
    "export over a list": (["export", "octree.safetensors", "--out", "mesh.ply"], FOREIGN),
    "run over a report": ([*RUN, "--out", "report"], FOREIGN),
    "run over a picture": ([*RUN, "--out", "picture"], FOREIGN),
    "run over a camera's file": ([*RUN, "--out", "camera"], WAY),
    "run into a file": ([*RUN, "--out", "mesh.ply"], WAY),
    "run --frames over a report": ([*RUN, "--frames", "1-2", "--out", "frame"], FOREIGN),
    "demo over a scene": (["demo", "--out", "scene"], FOREIGN),
    "verify-light over a report": (["verify-light", "small.blend", "--depth", "4", "--out", "report"], FOREIGN),
    "dataset": (["lab", "dataset", "octree.safetensors", "--out", "samples"], FOREIGN),
    "train over weights": (["lab", "train", "octree.safetensors", "--out", "weights"], FOREIGN),
    "train over what it reads": (["lab", "train", "octree/../weights/patchnet.safetensors", "--out", "weights"], READ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_commands_refuse(name: str, unchanged: None, capsys: pytest.CaptureFixture[str]) -> None:
    words, why = REFUSED[name]
    assert commands.main(words) == 2
    said = capsys.readouterr().err
    last = said.strip().splitlines()[-1]
    assert last.startswith("patchnet: error: ") and why in last and "Traceback" not in said
    assert not any(stage in said for stage in STAGES), "it has begun"


def test_the_scenes_own_files_are_not_replaced(
    tmp_path: Path, weights: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A picture of an earlier run that is a texture now."""
    build()
    scene, out = saved(tmp_path / "small.blend"), tmp_path / "out" / "frame-0001"
    words = ["run", str(scene), "--weights", str(weights), *QUICK]
    assert commands.main([*words, "--out", str(out)]) == 0
    bpy.data.images.load(str(out / "Eye" / "preview.png")).use_fake_user = True
    bpy.ops.wm.save_as_mainfile(filepath=str(scene))
    for where in (["--out", str(out)], ["--out", str(out.parent), "--frames", "1"]):
        assert commands.main([*words, *where]) == 2
        assert "preview.png is an input" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("call", "why"),
    [
        ("run_all(out='//report')", FOREIGN),
        ("bake_animation(frame_start=1, frame_end=2, out='//record')", FOREIGN),
        ("export_octree(filepath=FILES + '/mesh.ply')", FOREIGN),
        ("export_octree(filepath=FILES + '/nowhere/a.ply')", "does not exist"),
    ],
)
def test_operators_refuse(
    call: str, why: str, files: Path, registered: None, unchanged: None, capfd: pytest.CaptureFixture[str]
) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(files / "small.blend"))
    settings = bpy.context.scene.patchnet
    settings.depth, settings.resolution, settings.light, settings.size = 4, "DEPTH", "two-lights", (16, 16)
    if call.startswith("export"):
        bpy.ops.patchnet.voxelize()
    with pytest.raises(RuntimeError, match=why):
        eval(f"bpy.ops.patchnet.{call}", {"bpy": bpy, "FILES": str(files)})
    assert "Traceback" not in capfd.readouterr().err


def test_what_the_open_file_names_is_not_exported_over(files: Path, registered: None, unchanged: None) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(files / "small.blend"))
    volume = bpy.data.volumes.new("Volume")  # of which Blender does not ask what it is
    volume.filepath = str(files / "octree.safetensors")
    bpy.ops.patchnet.voxelize(depth=4)
    with pytest.raises(RuntimeError, match=READ):
        bpy.ops.patchnet.export_octree(filepath=str(files / "link.safetensors"))
