# SPDX-License-Identifier: GPL-3.0-or-later
"""Each camera has a folder of its own, which the report names, and none is left by a run that it omits."""

import json
import os
import tempfile
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet import commands
from patchnet.operators.pipeline.output_files import camera_folders, job_files, output_folder
from patchnet.operators.pipeline.reports import write_report
from patchnet.operators.scene_access.images import save_png
from patchnet.operators.settings.cycles_settings import CyclesSettings
from patchnet.patchnet_addon.runtime.errors import OutputError
from patchnet.patchnet_addon.runtime.file_kinds import OCTREE
from patchnet.patchnet_addon.runtime.replace import replaced_file
from patchnet.tests.blender.job_scene import QUICK, build, saved

ALIKE = ("A/b", "A?b", "A_b", "Cam", "cam", "Camera.001", "Camera_001", "straße", "STRASSE", "con", "", "é", "e\u0301")


def test_folders_differ_for_every_file_system() -> None:
    folders = camera_folders(ALIKE)
    assert len({folder.casefold() for folder in folders.values()}) == len(ALIKE)
    assert all(folder and not set(folder) & set('/\\?<>:*|". ') for folder in folders.values())
    assert folders["A_b"] == "A_b" and folders["Camera_001"] == "Camera_001", "a name that can stay does"
    assert folders["con"] != "con"
    assert camera_folders(reversed(ALIKE)) == folders
    assert camera_folders(["Camera.001", "Eye", "漢字"]) == {"Camera.001": "Camera_001", "Eye": "Eye", "漢字": "漢字"}
    trap = camera_folders(["A/b", "A?b"])["A/b"]
    assert len(set(camera_folders(["A/b", "A?b", trap]).values())) == 3, "a name that a hash could make"
    folders = camera_folders(["漢" * 80, "漢" * 81])
    assert len(set(folders.values())) == 2 and all(len(folder.encode()) < 200 for folder in folders.values())


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small scene with more cameras, whose names are the same for some file system."""
    build()
    eye = bpy.data.objects["Eye"]
    for name in ("A/b", "A?b", "Cam", "cam"):
        camera = eye.copy()
        camera.name = name
        bpy.context.scene.collection.objects.link(camera)
    return saved(tmp_path_factory.mktemp("cameras") / "cameras.blend")


def run(scene: Path, out: Path, weights: Path, *words: str) -> dict:
    assert commands.main(["run", str(scene), "--weights", str(weights), *QUICK, "--out", str(out), *words]) == 0
    return json.loads((out / "report.json").read_text())


def folders_in(out: Path) -> set[str]:
    return {path.name for path in out.iterdir() if path.is_dir()}


def test_a_rerun_with_fewer_cameras_leaves_no_folders_that_its_report_omits(
    scene: Path, tmp_path: Path, weights: Path
) -> None:
    out = tmp_path / "out"
    report = run(scene, out, weights, "--cameras", "all")
    folders = {frame["camera"]: frame["folder"] for frame in report["frames"]}
    assert folders_in(out) == set(folders.values()) and len(folders) == 5
    assert set(report["files"]) == {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert set(report["files"]) == set(job_files(folders.values(), None))
    (out / folders["A/b"] / "notes.txt").write_text("mine")
    (out / folders["Cam"] / "preview.png").write_text("no picture any more")
    (out / "mine").mkdir()
    (out / "mine" / "preview.png").write_bytes((out / "overview.png").read_bytes())
    again = run(scene, out, weights, "--cameras", "cam,A?b")
    assert {frame["camera"]: frame["folder"] for frame in again["frames"]} == {
        name: folders[name] for name in ("cam", "A?b")
    }, "the same folders, whichever cameras are looked through"
    assert folders_in(out) == {*folders.values(), "mine"} - {folders["Eye"]}
    assert [path.name for path in (out / folders["A/b"]).iterdir()] == ["notes.txt"]
    assert [path.name for path in (out / folders["Cam"]).iterdir()] == ["preview.png"]
    assert (out / "mine" / "preview.png").exists()


def test_pictures_by_cycles_are_foreseen(scene: Path, tmp_path: Path, weights: Path) -> None:
    cycles = ["--cycles-budget", "0.1", "--cycles-samples", "1", "--cycles-compare"]
    report = run(scene, tmp_path, weights, "--light", "cycles", "--max-samples", "2", *cycles)
    assert set(report["files"]) == set(job_files(["Eye"], CyclesSettings(compare=True)))
    assert (tmp_path / "Eye" / "cycles_compare.png").is_file()
    run(scene, tmp_path, weights)
    assert not list((tmp_path / "Eye").glob("cycles*")) and (tmp_path / "Eye" / "preview.png").is_file()


def test_other_jobs_reports_and_links_lead_to_nothing_that_goes(tmp_path: Path) -> None:
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    picture = b"\x89PNG\r\n\x1a\n" + bytes(10)
    for folder in (out / "Eye", elsewhere):
        folder.mkdir(parents=True)
        (folder / "a.png").write_bytes(picture)
    (out / "link").symlink_to(elsewhere)
    names = ["Eye/a.png", "link/a.png", "../elsewhere/a.png", str(elsewhere / "a.png"), 5, "", "report.json"]
    report = {"versions": {"patchnet": "0"}, "job": "light check", "files": names}

    def finish(job: str) -> None:
        (out / "report.json").write_text(json.dumps(report))
        with output_folder(out, job_files((), None)) as folder:
            write_report(folder, job, {"versions": {"patchnet": "0"}})

    finish("views")
    assert (out / "Eye" / "a.png").exists(), "of another job"
    report["files"] = [name for name in names if isinstance(name, str)]
    finish("light check")
    assert not (out / "Eye").exists() and (elsewhere / "a.png").read_bytes() == picture


SHM = Path("/dev/shm")


@pytest.mark.skipif(not SHM.is_dir(), reason="there is no other disk here for sure")
def test_a_folder_on_another_disk(tmp_path: Path) -> None:
    """To which nothing can be renamed."""
    out = tmp_path / "out"
    out.mkdir()
    with tempfile.TemporaryDirectory(dir=SHM) as other:
        if os.stat(other).st_dev == os.stat(tmp_path).st_dev:
            pytest.skip("temporary files are on the same disk")
        (out / "Eye").symlink_to(other)
        with output_folder(out, job_files(["Eye"], None)) as folder:
            (folder / "Eye").mkdir()
            save_png(folder / "Eye" / "preview.png", np.zeros((2, 2)))
            write_report(folder, "views", {"versions": {"patchnet": "0"}})
        assert os.listdir(other) == ["preview.png"]
    assert sorted(os.listdir(out)) == ["Eye", "report.json"]


def test_errors_name_files_as_they_would_be(tmp_path: Path) -> None:
    """The folder in which results are gathered is gone when the user reads of it."""
    out = tmp_path / "out"
    with (
        pytest.raises(OutputError, match=f"{out}/octree.safetensors is a folder"),
        output_folder(out, job_files((), None)) as folder,
    ):
        (folder / "octree.safetensors").mkdir()
        with replaced_file(folder / "octree.safetensors", OCTREE):
            pass
    with (
        pytest.raises(OutputError, match=f"{out}/Eye cannot be written .File exists"),
        output_folder(out, job_files((), None)) as folder,
    ):
        for _ in range(2):
            (folder / "Eye").mkdir()
    with pytest.raises(OSError) as caught, output_folder(out, job_files((), None)):
        raise OSError(28, "No space left on device", "/cache/kernels")
    assert caught.value.filename == "/cache/kernels" and not os.listdir(tmp_path)


def test_results_that_cannot_be_placed_in_the_end_replace_nothing(tmp_path: Path) -> None:
    """Somebody may have put something there meanwhile."""
    out = tmp_path / "out"
    with pytest.raises(OutputError, match="is not replaced"), output_folder(out, job_files((), None)) as folder:
        write_report(folder, "views", {"versions": {"patchnet": "0"}})
        out.mkdir()
        (out / "overview.png").write_text("mine")
    assert [path.name for path in out.iterdir()] == ["overview.png"] and [path.name for path in tmp_path.iterdir()] == [
        "out"
    ]
