# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory that goes back to the system, and what is left as it was."""

import mmap
import os
import subprocess
import sys
from pathlib import Path

import pytest

from patchnet.patchnet_addon.runtime.heap import page_out, peak_bytes, resident_bytes, trim

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux says what a process takes")
SIZE = 64 << 20


def lies_on_disk(path: Path) -> bool:
    kind = subprocess.run(["stat", "-f", "-c", "%T", path], capture_output=True, text=True, check=True).stdout.strip()
    return kind not in ("tmpfs", "ramfs")


def test_pages_of_a_library_go_back_and_are_read_again(tmp_path: Path) -> None:
    path = tmp_path / "libbig.so"
    content = os.urandom(1 << 20) * (SIZE >> 20)
    path.write_bytes(content)
    with path.open("rb") as file:
        os.fsync(file.fileno())
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as pages:
            assert pages[:] == content
            before = resident_bytes()
            page_out("libother")
            assert abs(resident_bytes() - before) < SIZE // 4
            page_out("libbig")
            if lies_on_disk(path):
                assert resident_bytes() < before - SIZE // 2
            assert pages[:] == content


def test_trim_leaves_what_is_used() -> None:
    kept = [bytes(1000) for _ in range(10000)]
    trim()
    assert all(item == bytes(1000) for item in kept)
    assert 0 < resident_bytes() <= peak_bytes()
