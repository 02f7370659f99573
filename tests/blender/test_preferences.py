# SPDX-License-Identifier: GPL-3.0-or-later
"""Preferences: the cache and what is deleted from it, diagnostics."""

import json
import logging
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.cache import cache_size, clear_cache, size_text
from patchnet.operators.copy_diagnostics import diagnostics
from patchnet.operators.properties import preferences
from patchnet.operators.session import results
from patchnet.patchnet_addon.light.surfel_cache import SurfelCache
from patchnet.patchnet_addon.process import own_wheels
from patchnet.tests.blender.drawn import drawn
from patchnet.tests.blender.job_scene import SMALL

pytestmark = pytest.mark.usefixtures("scene")


def fill(root: Path) -> set[Path]:
    """A cache as it is made, in a folder that holds a user's own things as well; those."""
    kernels = root / "kernels" / ("0123456789abcdef") / "octree_1a"
    kernels.mkdir(parents=True)
    for name in ("clip.area-12.py311.nbi", "clip.area-12.py311.1.nbc"):
        (kernels / name).write_bytes(b"x" * 1000)
    (kernels.parent / "all-0123456789abcdef").touch()
    package = root / "wheels" / "0123456789abcdef" / "llvmlite"
    package.mkdir(parents=True)
    (package.parent / "wheels.txt").touch()
    (package / "__init__.py").write_bytes(b"x" * 500)
    kept = SurfelCache("0123456789abcdef" * 2, root / "bakes")
    kept.save(3, np.arange(16, dtype=np.uint64), 4, np.ones((16, 6), np.float32))
    own = {
        root / "holiday.jpg", root / "kernels" / "notes.txt", root / "kernels" / "0123456789abcdef" / "mine.txt",
        root / "wheels" / "cart.txt", root / "bakes" / "cake.txt",
        root / "bakes" / "round-00-0123456789abcdef.safetensors",
        root / "bakes" / ("0123456789abcdef" * 2) / "mine.safetensors",
        root / "bakes" / "bread" / "round-00-0123456789abcdef.safetensors",
        root / "kernels" / "0123456789abcdef" / "octree_1a" / "all-0123456789abcdef",
    }  # fmt: skip
    for path in own:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("mine")
    return own


def test_cache_is_measured_and_cleared_without_touching_other_files(tmp_path: Path) -> None:
    own = fill(tmp_path)
    size = cache_size(tmp_path)
    assert size["kernels"] == 2000 and size["wheels"] == 500 and 256 < size["bakes"] < 8000
    assert clear_cache(tmp_path) == sum(size.values())
    assert {path for path in tmp_path.rglob("*") if path.is_file()} == own
    assert sum(cache_size(tmp_path).values()) == 0 == clear_cache(tmp_path)


def test_diagnostics_name_other_wheels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "llvmlite-0.0.1-cp{}{}-any.whl".format(*sys.version_info)).touch()
    assert json.loads(diagnostics(bpy.context))["engine"] == ""
    monkeypatch.setattr(own_wheels, "_FOLDER", tmp_path)
    assert "for all: PatchNet computes with its own 0.0.1" in json.loads(diagnostics(bpy.context))["engine"]


def test_links_are_not_followed(tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    fill(outside)
    root = tmp_path / "cache"
    root.mkdir()
    (root / "kernels").symlink_to(outside / "kernels", target_is_directory=True)
    (root / "bakes").mkdir()
    (root / "bakes" / ("f" * 32)).symlink_to(outside / "bakes" / ("0123456789abcdef" * 2), target_is_directory=True)
    before = cache_size(outside)
    assert clear_cache(root) == 0 and cache_size(outside) == before
    assert clear_cache(tmp_path / "nothing") == 0


def test_operators_of_the_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATCHNET_CACHE", str(tmp_path))
    own = fill(tmp_path)
    assert bpy.ops.patchnet.clear_cache() == {"FINISHED"}
    assert size_text(cache_size(tmp_path)).startswith("0.0 MiB") and all(path.exists() for path in own)


def test_preferences_draw() -> None:
    texts = drawn(preferences.PatchNetPreferences)
    assert "patchnet.clear_cache" in texts and "patchnet.copy_diagnostics" in texts


def test_diagnostics() -> None:
    bpy.ops.patchnet.run_all(light="two-lights", **SMALL)
    with pytest.raises(RuntimeError, match="Nobody"):
        bpy.ops.patchnet.run_all(cameras="Nobody", **SMALL)
    text = diagnostics(bpy.context)
    said = json.loads(text)
    assert said["versions"]["blender"] == bpy.app.version_string and said["machine"]["cores"] > 0
    assert said["settings"]["light"] == "cycles" and said["result"] == results.voxels_of(bpy.context.scene).summary
    assert any("Nobody" in line for line in said["last warnings and errors"])
    assert str(Path.home()) not in text
    assert bpy.ops.patchnet.copy_diagnostics() == {"FINISHED"}


def test_warnings_are_told_where_the_extension_is_registered(capsys: pytest.CaptureFixture[str]) -> None:
    preferences.apply_preferences(bpy.context)
    logging.getLogger("patchnet").warning("The cache folder cannot be used")
    assert capsys.readouterr().err.count("The cache folder cannot be used") == 1
    assert "The cache folder cannot be used" in diagnostics(bpy.context)
