# SPDX-License-Identifier: GPL-3.0-or-later
"""Fallbacks for an unusable cache folder, the cache of compiled kernels, age and size of bakes."""

import logging
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from numba.core.caching import IndexDataCacheFile

from patchnet.patchnet_addon.light.surfel_cache import SurfelCache, tidy
from patchnet.patchnet_addon.runtime import cache_folder
from patchnet.patchnet_addon.runtime.cache_folder import kernel_folder, user_cache_folder
from patchnet.patchnet_addon.runtime.kernels import CacheFile

KERNEL = """
import logging, sys
import numba, numpy as np
from patchnet.patchnet_addon.runtime.kernels import kernel

@kernel
def total(values):
    result = 0.0
    for value in values:
        result += value
    return result

if len(sys.argv) > 1:
    from numba.core.caching import IndexDataCacheFile
    def full(self, key, data):
        raise OSError(28, "No space left on device")
    IndexDataCacheFile.save = full
    kernel(lambda value: value + 1.0)(1.0)
print(total(np.ones(3)), sum(total.stats.cache_hits.values()), numba.config.CACHE_DIR)
"""


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for temporary files of its own, and no memory of earlier answers."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    monkeypatch.setenv("TMPDIR", str(folder))
    cache_folder._usable.cache_clear()
    yield folder
    cache_folder._usable.cache_clear()


@pytest.fixture
def unusable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """PATCHNET_CACHE names a file, which not even root can make a folder in."""
    path = tmp_path / "cache"
    path.write_text("in the way")
    monkeypatch.setenv("PATCHNET_CACHE", str(path))
    return path


def test_another_takes_its_place_and_it_is_said_once(
    unusable: Path, temporary: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING, "patchnet"):
        first = user_cache_folder()
        assert user_cache_folder() == first
        SurfelCache("0" * 32)
    assert first.parent == temporary and not first.stat().st_mode & 0o077
    (said,) = caplog.messages
    assert str(unusable) in said and str(first) in said and "cannot be used" in said and "PATCHNET_CACHE" in said


@pytest.mark.skipif(os.name == "nt", reason="Windows has a variable for it")
def test_a_user_without_a_home(temporary: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> Path:
        raise RuntimeError("Could not determine home directory.")

    for name in ("PATCHNET_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", none)
    assert user_cache_folder().parent == temporary


def test_kernels_that_are_there_are_taken_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted, place = tmp_path / "wanted", tmp_path / "place"
    module = wanted / "kernels" / "0123456789abcdef" / "tracing_1"
    module.mkdir(parents=True)
    (module / "a.nbi").write_text("index")
    (module / "a.1.nbc").write_text("code")
    module.chmod(0o555)
    monkeypatch.setenv("PATCHNET_CACHE", str(wanted))
    assert kernel_folder(wanted, "0123456789abcdef") == wanted / "kernels" / "0123456789abcdef"
    folder = kernel_folder(place, "0123456789abcdef")
    assert (folder / "tracing_1" / "a.1.nbc").read_text() == "code"
    assert os.listdir(folder.parent) == [folder.name] and os.access(folder / "tracing_1", os.W_OK)
    assert kernel_folder(place, "1" * 16) == place / "kernels" / ("1" * 16)


def start(script: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(script), *arguments], capture_output=True, text=True, check=True, env=dict(os.environ)
    )


@pytest.fixture
def script(tmp_path: Path) -> Path:
    path = tmp_path / "kernel.py"
    path.write_text(KERNEL)
    return path


def test_the_next_start_compiles_nothing(tmp_path: Path, script: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATCHNET_CACHE", str(tmp_path / "cache"))
    first, second = start(script), start(script)
    assert first.stdout.startswith("3.0 0 ") and second.stdout.startswith("3.0 1 ")
    assert first.stdout.split()[2].startswith(str(tmp_path / "cache")) and not first.stderr


def test_a_fallback_goes_with_its_process(unusable: Path, temporary: Path, script: Path) -> None:
    done = start(script)
    assert done.stdout.startswith("3.0 0 ") and done.stdout.split()[2].startswith(str(temporary))
    assert done.stderr.count("cannot be used") == 1 and not os.listdir(temporary)


def test_a_full_disk_costs_only_the_compiling(tmp_path: Path, script: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATCHNET_CACHE", str(tmp_path / "full"))
    done = start(script, "full")
    assert done.stdout.startswith("3.0 0 ") and "Traceback" not in done.stderr
    assert done.stderr.count("No space left on device") == 1 and str(tmp_path / "full") in done.stderr


def test_processes_that_compile_at_once_do_not_swap_their_code(temporary: Path) -> None:
    """Both have looked at the index before either wrote it, and whose index lasts is the first to write its code."""
    first, second, later = (CacheFile(str(temporary), "total", ("stamp",)) for _ in range(3))
    seen = []

    def write_before(name: str, data: str) -> None:
        seen.append(name)
        IndexDataCacheFile._save_data(second, name, data)
        IndexDataCacheFile._save_data(first, seen[0], "of the first")

    first._load_index = second._load_index = dict
    first._save_data = lambda name, data: seen.append(name)
    second._save_data = write_before
    first.save("one type", "of the first")
    second.save("another type", "of the second")
    assert later.load("another type") == "of the second"
    assert later.load("one type") in (None, "of the first")


def bake_of(root: Path, name: str, age_s: float, size: int) -> Path:
    folder = root / name
    folder.mkdir()
    (folder / "round-00-0.safetensors").write_bytes(bytes(size))
    then = time.time() - age_s
    os.utime(folder, (then, then))
    return folder


def test_old_and_large_bakes_go(tmp_path: Path) -> None:
    day, root = 24 * 3600.0, tmp_path / "bakes"
    root.mkdir()
    for name, days in {"ancient": 40, "old": 3, "older": 4, "mine": 50}.items():
        bake_of(root, name, days * day, 1000)
    bake_of(root, "running elsewhere", 60.0, 5000)
    tidy(root, keep="mine", max_bytes=7500)
    assert {path.name for path in root.iterdir()} == {"old", "mine", "running elsewhere"}
    tidy(root, keep="mine", max_bytes=100)
    assert {path.name for path in root.iterdir()} == {"mine", "running elsewhere"}
