# SPDX-License-Identifier: GPL-3.0-or-later
"""Finished pages of bakes on disk are removed by age and size."""

import os
import time
from pathlib import Path

from patchnet.patchnet_addon.lightmap.page_cache import tidy


def bake_of(root: Path, name: str, age_s: float, size: int) -> Path:
    folder = root / name
    folder.mkdir()
    (folder / "page-00000.safetensors").write_bytes(bytes(size))
    then = time.time() - age_s
    os.utime(folder, (then, then))
    return folder


def test_old_and_large_bakes_go(tmp_path: Path) -> None:
    day = 24 * 3600.0
    for name, days in {"ancient": 40, "old": 3, "older": 4, "mine": 50}.items():
        bake_of(tmp_path, name, days * day, 1000)
    bake_of(tmp_path, "running elsewhere", 60.0, 5000)
    tidy(tmp_path, keep="mine", max_bytes=7500)
    assert {path.name for path in tmp_path.iterdir()} == {"old", "mine", "running elsewhere"}
    tidy(tmp_path, keep="mine", max_bytes=100)
    assert {path.name for path in tmp_path.iterdir()} == {"mine", "running elsewhere"}
