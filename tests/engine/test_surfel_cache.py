# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfels on disk: what was baked comes back; what is damaged, or cannot be written, costs only time."""

import logging
from pathlib import Path

import numpy as np
import pytest

from patchnet.patchnet_addon.light import surfel_cache
from patchnet.patchnet_addon.light.surfel_cache import SurfelCache
from patchnet.patchnet_addon.runtime.files import read_arrays

IDS = np.random.default_rng(0).permutation(2**63 + np.arange(40, dtype=np.uint64) * np.uint64(2**50))
BAKED = np.random.default_rng(1).random((40, 3)).astype(np.float32)


@pytest.fixture
def kept(tmp_path: Path) -> SurfelCache:
    """Two calls of a round, and one of the next."""
    cache = SurfelCache("key", tmp_path)
    for call in (slice(0, 10), slice(10, 25)):
        cache.save(0, IDS[call], 4, BAKED[call])
    cache.save(1, IDS[:5], 4, BAKED[:5] + 1.0)
    return cache


def test_what_was_saved_is_loaded_in_any_order(kept: SurfelCache, tmp_path: Path) -> None:
    order = np.random.default_rng(2).permutation(40)[:30]
    for cache in (kept, SurfelCache("key", tmp_path)):
        baked, there = cache.load(0, IDS[order], 4, 3)
        np.testing.assert_array_equal(there, order < 25)
        np.testing.assert_array_equal(baked, np.where(there[:, None], BAKED[order], 0.0))
    baked, there = kept.load(1, IDS, 4, 3)
    np.testing.assert_array_equal(baked[:5], BAKED[:5] + 1.0)
    assert there.sum() == 5


@pytest.mark.parametrize(
    ("number", "samples", "channels", "key"), [(2, 4, 3, "key"), (0, 8, 3, "key"), (0, 4, 6, "key"), (0, 4, 3, "other")]
)
def test_what_differs_is_not_taken(
    kept: SurfelCache, tmp_path: Path, number: int, samples: int, channels: int, key: str
) -> None:
    """Another round, other paths, other channels, another key."""
    baked, there = SurfelCache(key, tmp_path).load(number, IDS, samples, channels)
    assert not there.any() and not baked.any() and baked.shape == (40, channels)


def test_the_same_surfels_with_more_paths_are_kept_beside_them(kept: SurfelCache) -> None:
    for samples in (3, 260, 65540):
        kept.save(0, IDS[:10], samples, BAKED[:10] * np.float32(samples))
    for samples in (3, 260, 65540):
        np.testing.assert_array_equal(kept.load(0, IDS[:10], samples, 3)[0], BAKED[:10] * np.float32(samples))
    np.testing.assert_array_equal(kept.load(0, IDS[:10], 4, 3)[0], BAKED[:10])


def test_no_surfels_are_no_light(kept: SurfelCache) -> None:
    """Their round may have files of other cameras."""
    baked, there = kept.load(0, IDS[:0], 4, 3)
    assert baked.shape == (0, 3) and there.shape == (0,)
    kept.save(0, IDS[:0], 4, BAKED[:0])
    assert kept.load(0, IDS, 4, 3)[1].sum() == 25


def test_a_damaged_file_is_baked_again(kept: SurfelCache, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    files = (tmp_path / "key").glob("round-00-*")
    damaged = next(path for path in files if len(read_arrays(path, surfel_cache.KIND)[0]["ids"]) == 15)
    damaged.write_bytes(damaged.read_bytes()[:-7])
    with caplog.at_level(logging.WARNING, "patchnet"):
        np.testing.assert_array_equal(kept.load(0, IDS, 4, 3)[1], np.arange(40) < 10)
    assert len(caplog.messages) == 1 and "baked again" in caplog.text and not damaged.exists()
    kept.save(0, IDS[10:25], 4, BAKED[10:25])
    assert kept.load(0, IDS, 4, 3)[1].sum() == 25


def test_a_folder_that_cannot_be_made_costs_a_warning(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    root = tmp_path / "file"
    root.write_text("in the way")
    with caplog.at_level(logging.WARNING, "patchnet"):
        cache = SurfelCache("key", root)
        cache.save(0, IDS, 4, BAKED)
        assert not cache.load(0, IDS, 4, 3)[1].any()
    assert len(caplog.messages) == 1 and "cannot be kept" in caplog.text and root.read_text() == "in the way"


def test_a_full_disk_costs_a_warning(
    kept: SurfelCache, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(surfel_cache, "write_arrays", full)
    with caplog.at_level(logging.WARNING, "patchnet"):
        for number in range(2, 5):
            kept.save(number, IDS, 4, BAKED)
    assert len(caplog.messages) == 1 and "No space left" in caplog.text
    assert kept.load(0, IDS, 4, 3)[1].sum() == 25
