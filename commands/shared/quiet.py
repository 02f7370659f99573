# SPDX-License-Identifier: GPL-3.0-or-later
"""Silence Blender's and Cycles' own lines on the terminal, which would bury the progress bars."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from ...patchnet_addon.runtime.streams import diverted


@contextmanager
def quiet_stdout() -> Iterator[None]:
    """Silence stdout of the process within the block, whether Python or compiled code writes to it."""
    with open(os.devnull, "wb") as nowhere, diverted(stdout=nowhere):
        yield
