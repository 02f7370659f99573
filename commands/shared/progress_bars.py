# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress of a job on stderr: a line that is written over on a terminal, plain lines in a file, or log events."""

from __future__ import annotations

import shutil
import sys
import time

from ...patchnet_addon.runtime.eta import Eta
from ...patchnet_addon.runtime.log import is_json
from ...patchnet_addon.runtime.progress import Progress
from ...patchnet_addon.runtime.progress_log import ProgressLog

_PAUSE_S, _LOG_PAUSE_S = 0.1, 60.0  # between two lines of a step, on a terminal and in a file
_WIDTH = 20  # characters of the bar


class ProgressBars:
    """Context manager whose `show` is an `on_progress` of `drain`."""

    def __init__(self) -> None:
        self._is_terminal = sys.stderr is not None and sys.stderr.isatty()
        self.show = ProgressLog("").see if is_json() else self._show
        self._label, self._said = "", 0.0
        self._eta = Eta()

    def __enter__(self) -> ProgressBars:
        return self

    def __exit__(self, *_: object) -> None:
        if self._is_terminal and self._label:
            self._write("")

    @staticmethod
    def _write(text: str) -> None:
        """Write over the line of the terminal."""
        columns = shutil.get_terminal_size().columns - 1
        print(f"\r{text[:columns]:<{columns}}\r", end="", file=sys.stderr, flush=True)

    def _show(self, progress: Progress) -> None:
        """Print the start of a step, and its progress at intervals."""
        self._eta.see(progress)
        begins, now = progress.label != self._label, time.monotonic()
        if not begins and now - self._said < (_PAUSE_S if self._is_terminal else _LOG_PAUSE_S):
            return
        self._label, self._said = progress.label, now
        left = self._eta.text()
        if self._is_terminal:
            share = progress.fraction if progress.whole is None else progress.whole
            bar = ("#" * round(_WIDTH * share)).ljust(_WIDTH, ".")
            text = f"{progress.label:<36} {bar} {share:4.0%}  {', '.join(filter(None, (left, progress.note)))}"
            self._write(text)
        elif begins:
            print(progress.label, file=sys.stderr, flush=True)
        else:
            print(f"{progress.label}: {progress.fraction:.0%}{', ' if left else ''}{left}", file=sys.stderr, flush=True)
