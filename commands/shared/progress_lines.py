# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress of a job on stderr: lines for users, or log events."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

from ...patchnet_addon.runtime.eta import Eta
from ...patchnet_addon.runtime.log import is_json
from ...patchnet_addon.runtime.progress import Progress
from ...patchnet_addon.runtime.progress_log import ProgressLog

_PAUSE_S = 10.0  # between two lines of a step


def progress_lines() -> Callable[[Progress], None]:
    """`on_progress` of `drain`."""
    return ProgressLog("").see if is_json() else _Lines().show


class _Lines:
    """Progress lines: at the start of a step, and at intervals."""

    def __init__(self) -> None:
        self._label = ""
        self._said = 0.0
        self._eta = Eta()

    def show(self, progress: Progress) -> None:
        self._eta.see(progress)
        now = time.monotonic()
        if progress.label == self._label and now - self._said < _PAUSE_S:
            return
        text = progress.label
        if progress.label == self._label:
            text = f"{text}: {', '.join(filter(None, (f'{progress.fraction:.0%}', self._eta.text(), progress.note)))}"
        self._label, self._said = progress.label, now
        print(text, file=sys.stderr, flush=True)
