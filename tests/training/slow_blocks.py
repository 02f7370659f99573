# SPDX-License-Identifier: GPL-3.0-or-later
"""Blocks of frames that take minutes, for processes that are started anew."""

import time
from pathlib import Path


def evaluate_slowly(mark: Path) -> None:
    """Say that it has begun, and go on for longer than anybody waits."""
    mark.touch()
    time.sleep(300)
