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


@contextmanager
def quiet_import() -> Iterator[None]:
    """Leave out the line about /etc/mtab that Blender prints at its import where there is none, as in containers.

    Only its file browser reads that file. All else that the block prints goes to stderr at its end.
    """
    with tempfile.TemporaryFile() as said:
        with diverted(stdout=said, stderr=said):
            yield
        said.seek(0)
        sys.stderr.writelines(line.decode(errors="replace") for line in said if b"mounted file-systems" not in line)
