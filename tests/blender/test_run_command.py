# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet run`, `info` and `octree`: files of several kinds and wrong input."""

import json
import os
import subprocess
import sys
from pathlib import Path

import bpy
import pytest

from patchnet import commands
from patchnet.patchnet_addon.network.weights import load_weights
from patchnet.patchnet_addon.octree.file import load_octree
from patchnet.patchnet_addon.runtime.quantities import error_text
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.tests.blender.job_scene import QUICK, build, saved

WITHOUT_MTAB = """
mount -t tmpfs tmpfs "$1" && cp -a /etc/. "$1" && rm -f "$1/mtab" && mount --bind "$1" /etc || exit 99
exec "$2" -m patchnet run "$1/missing.glb"
"""


def run(scene: Path, out: Path, weights: Path, *arguments: str) -> int:
    return commands.main(["run", str(scene), "--out", str(out), "--weights", str(weights), *QUICK, *arguments])


def test_run_writes_what_it_promises(
    scene_file: Path, tmp_path: Path, weights: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = ["--cameras", "all", "--strategy", "ss-variance", "--budget", "0.5", "--reference", "--no-denoise"]
    assert run(scene_file, out, weights, *words, "--gloss=auto") == 0
    report = json.loads((out / "report.json").read_text())
    assert report["strategy"] == "ss-variance"
    assert [frame["camera"] for frame in report["frames"]] == ["Eye"]
    assert report["frames"][0]["budget"] == 0.5
    assert {"nodes", "leaves", "bytes", "depth"} <= set(report["octree"])
    printed, noted = capsys.readouterr()
    assert all(f"Note: {flag} has no effect with --light two-lights" in noted for flag in ("--denoise", "--gloss"))
    assert "--max-samples has" not in noted and "Fra:" not in printed
    assert "ss-variance" in printed and "Octree: depth 5" in printed
    assert f"Results are in {out}: look at {out / 'overview.png'}" in printed and (out / "overview.png").is_file()
    for name, error in report["frames"][0]["mse"].items():
        assert f"  {name:<24} {error_text(error):>6}  {STRATEGIES[name].cost}" in printed
    assert f"error {error_text(report['frames'][0]['mse_unrefined'])} (mean squared, x 10,000)" in printed
    assert "linear luminance" in report["error_unit"]
    assert str(tmp_path) not in (out / "report.json").read_text()


def test_another_format_without_a_camera_and_light(
    tmp_path: Path, weights: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An .obj file; test_scene_files.py opens those of all formats."""
    build()
    path = tmp_path / "small.obj"
    bpy.ops.wm.obj_export(filepath=str(path))
    arguments = ["--light", "cycles", "--max-samples", "2", "--cameras", "auto"]
    assert run(path, tmp_path / "out", weights, *arguments) == 0
    assert "Note: The scene has no light: it was lit with a sun and a sky" in capsys.readouterr().err
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert [frame["camera"] for frame in report["frames"]] == ["Far", "Middle", "Close"]
    assert report["light"]["triangles"] == 72
    assert report["frames"][1]["active_pixels"] > 20


@pytest.mark.skipif(sys.platform != "linux" or os.geteuid() != 0, reason="hiding /etc/mtab takes root")
def test_blender_says_nothing_of_no_concern_at_its_import(tmp_path: Path) -> None:
    words = ["unshare", "--mount", "--propagation", "private", "sh", "-c", WITHOUT_MTAB, "sh", tmp_path, sys.executable]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode == 99 or "unshare" in done.stderr:
        pytest.skip("mounts are not allowed here")
    assert done.returncode == 2 and done.stderr.startswith("patchnet: error: ") and done.stderr.count("\n") == 1


def damaged(path: Path) -> Path:
    path.write_bytes(b"this is no scene, whatever its name says" * 20)
    return path


def without_camera(path: Path) -> Path:
    build(camera=False)
    return saved(path)


@pytest.mark.parametrize(
    ("make", "suffix", "message"), [(damaged, ".glb", "cannot be read"), (without_camera, ".blend", "no camera")]
)
def test_bad_scenes_end_with_one_sentence(
    make, suffix: str, message: str, tmp_path: Path, weights: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, out = make(tmp_path / f"scene{suffix}"), tmp_path / "out"
    out.mkdir()
    kept = json.dumps({"versions": {"patchnet": "0.0.1"}})
    (out / "report.json").write_text(kept)
    assert run(scene, out, weights) == 2
    assert_one_sentence(capsys.readouterr().err, message)
    assert [path.name for path in out.iterdir()] == ["report.json"]
    assert (out / "report.json").read_text() == kept


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--depth", "deep"], "auto"),
        (["--depth", "40"], "outside 1 to"),
        (["--depth", "14"], "GiB"),
        (["--voxel-size", "0.1"], "choose one of them"),
        (["--strategy", "best"], "patchnet-behind"),
        (["--cameras", "Nobody"], "'Eye'"),
        (["--colormap", "jet"], "viridis"),
        (["--exposure=0"], "--exposure 0.0 is outside"),
        (["--cycles-samples", "64"], "--cycles-samples requires --cycles-budget"),
        (["--cycles-light", "diffuse"], "--cycles-light requires --cycles-budget"),
        (["--spp", "4", "--refined-samples", "64"], "exclude each other"),
    ],
)
def test_bad_arguments_end_with_one_sentence(
    arguments: list[str], message: str, scene_file: Path, tmp_path: Path, weights: Path,
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr("patchnet.patchnet_addon.lod.memory.available_memory", lambda: 1 << 30)
    assert run(scene_file, tmp_path / "out", weights, *arguments) == 2
    assert_one_sentence(capsys.readouterr().err, message)
    assert not (tmp_path / "out").exists()


def test_info(scene_file: Path, tmp_path: Path, weights: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert run(scene_file, out, weights) == 0
    capsys.readouterr()
    for path, words in (
        (out / "octree.safetensors", ["PatchNet octree", "depth 5", "child_mask", "two-lights"]),
        (out / "codes.safetensors", ["PatchNet codes", "voxels with look-ahead", load_weights(weights).hash]),
        (weights, ["PatchNet weights", load_weights(weights).hash, "encoder.0.weight"]),
    ):
        assert commands.main(["info", str(path)]) == 0
        printed = capsys.readouterr().out
        assert all(word in printed for word in words), printed
    assert commands.main(["info", "--json", str(out / "octree.safetensors")]) == 0
    assert json.loads(capsys.readouterr().out)["metadata"]["depth"] == 5
    content = bytearray((out / "octree.safetensors").read_bytes())
    content[-50] ^= 0xFF
    (out / "octree.safetensors").write_bytes(content)
    assert commands.main(["info", str(out / "octree.safetensors")]) == 2
    assert_one_sentence(capsys.readouterr().err, "octree.safetensors")


def test_octree_of_a_part(scene_file: Path, tmp_path: Path) -> None:
    found = []
    for words in ([], ["--without", "lath 0"], ["--bisect", "x", "0.5"]):
        path = tmp_path / f"{len(found)}.safetensors"
        settings = ["--depth", "5", "--light", "two-lights", *words]
        assert commands.main(["octree", str(scene_file), "--out", str(path), *settings]) == 0
        found.append(load_octree(path))
    whole, without, half = found
    assert without.leaf_count < whole.leaf_count and half.leaf_count < whole.leaf_count and half.grid == whole.grid
    assert half.provenance["bisect"] == ["x", "0.5"] and "scene_state" not in half.provenance


def assert_one_sentence(text: str, message: str) -> None:
    """The last line is an error that holds `message`; nothing like a traceback is above it."""
    lines = text.strip().splitlines()
    assert lines[-1].startswith("patchnet: error: ") and message in lines[-1], text
    assert "Traceback" not in text


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--depth", "auto"], "--view"),
        (["--depth", "7", "--view", "1", "0", "0", "0", "0", "0"], "--view"),
        (["--depth", "deep"], "'deep'"),
        (["--depth", "7", "--size", "64", "48"], "--size requires --view"),
        (["--depth", "auto", "--view", "1", "0", "0", "0", "0", "0", "--rotate", "3"], "--rotate"),
        (["--depth", "auto", "--view", "1", "0", "0", "0", "0", "0", "--memory", "0"], "--memory"),
        (["--depth", "5", "--bisect", "w", "0.5"], "--bisect w is not an axis"),
        (["--depth", "5", "--bisect", "x", "1.5"], "--bisect"),
        (["--depth", "5", "--bisect", "x", "0.5", "--rotate", "3"], "--rotate"),
        (["--depth", "auto", "--view", "1", "0", "0", "0", "0", "0", "--bisect", "x", "0.5"], "--depth auto"),
    ],
)
def test_octree_settings_that_contradict_each_other(words, said, capfd):
    assert commands.main(["octree", "none.obj", "--out", "none.safetensors", *words]) == 2
    assert said in capfd.readouterr().err
