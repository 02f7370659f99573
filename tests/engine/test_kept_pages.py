# SPDX-License-Identifier: GPL-3.0-or-later
"""Finished pages of bakes on disk: kept, found, and cleaned up."""

import os
import time
from pathlib import Path

import numpy as np
import pytest

from patchnet.patchnet_addon.lightmap.page_cache import BakePageCache, tidy


def test_pages_stay_until_their_bake_ends(tmp_path: Path) -> None:
    texels = np.random.default_rng(0).random((2, 16, 2), np.float32)
    page = texels, np.array([1, 0, -1], np.int8), np.array([0.0, 0.5, 1.0], np.float32)
    with pytest.raises(ZeroDivisionError), BakePageCache(tmp_path) as kept:
        kept.open("nothing finished")
        kept.open("one")
        kept.save(3, *page)
        raise ZeroDivisionError
    assert [path.name for path in tmp_path.iterdir()] == ["one"]
    with BakePageCache(tmp_path) as kept:
        kept.open("other")
        assert kept.pages() == set() and kept.load(3, (2, 16, 2), 3) is None
        kept.open("one")
        assert kept.pages() == {3}
        found = kept.load(3, (2, 16, 2), 3)
        assert found is not None
        for array, wanted in zip(found, page, strict=True):
            np.testing.assert_array_equal(array, wanted)
        assert all(kept.load(*wrong) is None for wrong in ((3, (2, 64, 2), 3), (3, (2, 16, 2), 4), (4, (2, 16, 2), 3)))
    assert list(tmp_path.iterdir()) == []


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
