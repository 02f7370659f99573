# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory that goes back to the system, and what is left as it was."""

import sys

import pytest

from patchnet.patchnet_addon.runtime.heap import peak_bytes, resident_bytes, trim


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux says what a process takes")
def test_trim_leaves_what_is_used() -> None:
    kept = [bytes(1000) for _ in range(10000)]
    trim()
    assert all(item == bytes(1000) for item in kept)
    assert 0 < resident_bytes() <= peak_bytes()
