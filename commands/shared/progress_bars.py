# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress of a job on stderr: one bar for the whole job, or one per step.

Prints plain lines if stderr is not a terminal or tqdm is missing (Blender), or log events.
"""

from __future__ import annotations

import importlib.util
import sys
import time
from types import TracebackType
from typing import Any

from ...patchnet_addon.runtime.eta import Eta
from ...patchnet_addon.runtime.log import is_json
from ...patchnet_addon.runtime.progress import Progress
from ...patchnet_addon.runtime.progress_log import ProgressLog

_FORMAT = "{desc} {bar} {n:3.0f} % {elapsed}{postfix}"
_WHOLE = "the whole job"
_PAUSE_S, _LOG_PAUSE_S = 10.0, 60.0  # between two lines of a step, on a terminal and in a file


class ProgressBars:
    """Context manager whose `show` is an `on_progress` of `drain`."""

    def __init__(self) -> None:
        self._bars: _Bars | None = None
        if is_json():
            self.show = ProgressLog("").see
        elif sys.stderr is None or not sys.stderr.isatty():
            self.show = _Lines(_LOG_PAUSE_S).show
        elif importlib.util.find_spec("tqdm") is None:
            self.show = _Lines(_PAUSE_S).show
        else:
            self._bars = _Bars()
            self.show = self._bars.show

    def __enter__(self) -> ProgressBars:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bars is not None:
            self._bars.close(finished=kind is None)


class _Lines:
    """Progress lines: at the start of a step, and at intervals."""

    def __init__(self, pause_s: float) -> None:
        self._label, self._pause_s = "", pause_s
        self._said = 0.0
        self._eta = Eta()

    def show(self, progress: Progress) -> None:
        self._eta.see(progress)
        now = time.monotonic()
        if progress.label == self._label and now - self._said < self._pause_s:
            return
        text = progress.label
        if progress.label == self._label:
            left = self._eta.text()
            text += f": {progress.fraction:.0%}{', ' if left else ''}{left}"
        self._label, self._said = progress.label, now
        print(text, file=sys.stderr, flush=True)


class _Bars:
    """Progress bars: one for a whole job if its share is known, else one per step."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._title = self._step = ""
        self._eta = Eta()

    def show(self, progress: Progress) -> None:
        from tqdm import tqdm

        whole = progress.whole is not None
        done = 100.0 * (progress.whole if progress.whole is not None else progress.fraction)
        title = _WHOLE if whole else progress.label
        if self._bar is None or title != self._title or (not whole and done < self._bar.n - 1.0):
            self.close(finished=True)
            self._title, self._bar = title, tqdm(total=100.0, bar_format=_FORMAT)
        self._eta.see(progress)
        new, self._step = progress.label != self._step, progress.label
        self._bar.set_description_str(f"{progress.label:<36}", refresh=new)  # also shows short steps
        self._bar.set_postfix_str(", ".join(filter(None, (self._eta.text(), progress.note))), refresh=False)
        self._bar.update(max(done - self._bar.n, 0.0))

    def close(self, finished: bool) -> None:
        if self._bar is not None:
            if finished:
                self._bar.set_postfix_str("", refresh=False)
                self._bar.update(100.0 - self._bar.n)
            self._bar.close()
            self._bar = None
