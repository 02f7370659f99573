# SPDX-License-Identifier: GPL-3.0-or-later
"""Suppress Blender's and Cycles' own lines on the terminal, which would hide the progress."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

from ...patchnet_addon.runtime.streams import diverted

# Irrelevant lines: a missing /etc/mtab in containers; the path of the color configuration in 5.3.
_OF_NO_CONCERN = (b"mounted file-systems", b"color_management | Using config")


@contextmanager
def quiet_stdout() -> Iterator[None]:
    """Suppress stdout of the process within the block, of Python and compiled code."""
    with open(os.devnull, "wb") as nowhere, diverted(stdout=nowhere):
        yield


@contextmanager
def quiet_import() -> Iterator[None]:
    """Suppress irrelevant lines that Blender prints at its import; others go to stderr at the block's end."""
    with tempfile.TemporaryFile() as said:
        with diverted(stdout=said, stderr=said):
            yield
        said.seek(0)
        lines = [line for line in said if not any(known in line for known in _OF_NO_CONCERN)]
        sys.stderr.writelines(line.decode(errors="replace") for line in lines)
