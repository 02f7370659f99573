# SPDX-License-Identifier: GPL-3.0-or-later
"""Silence Blender's and Cycles' own lines on the terminal, which would bury the progress bars."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

from ...patchnet_addon.runtime.streams import diverted


@contextmanager
def quiet_stdout() -> Iterator[None]:
    """Silence stdout of the process within the block, whether Python or compiled code writes to it."""
    with open(os.devnull, "wb") as nowhere, diverted(stdout=nowhere):
        yield


# Lines that concern no user: its file browser misses /etc/mtab in a container; 5.3 names its file of colour spaces.
_OF_NO_CONCERN = (b"mounted file-systems", b"color_management | Using config")


@contextmanager
def quiet_import() -> Iterator[None]:
    """Leave out the lines of no concern that Blender prints at its import.

    All else that the block prints goes to stderr at its end.
    """
    with tempfile.TemporaryFile() as said:
        with diverted(stdout=said, stderr=said):
            yield
        said.seek(0)
        lines = [line for line in said if not any(known in line for known in _OF_NO_CONCERN)]
        sys.stderr.writelines(line.decode(errors="replace") for line in lines)
