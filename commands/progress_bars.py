# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress of a job on the terminal: one bar a step."""

from __future__ import annotations

from types import TracebackType
from typing import Any

from ..patchnet_addon.progress import Progress
from ..patchnet_addon.remaining import Remaining

_FORMAT = "{desc} {bar} {n:3.0f} % {elapsed}{postfix}"


class ProgressBars:
    """Context manager whose `show` is an `on_progress` of `drain`; a step that is named anew gets a new bar."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._label = ""
        self._remaining = Remaining()

    def __enter__(self) -> ProgressBars:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close(finished=kind is None)

    def show(self, progress: Progress) -> None:
        """Move the bar of the step `progress` speaks of."""
        from tqdm import tqdm

        restarted = self._bar is not None and 100.0 * progress.fraction < self._bar.n - 1.0
        if progress.label != self._label or self._bar is None or restarted:
            self._close(finished=True)
            self._label = progress.label
            self._bar = tqdm(total=100.0, desc=f"{progress.label:<36}", bar_format=_FORMAT)
        self._remaining.see(progress)
        self._bar.set_postfix_str(self._remaining.text(), refresh=False)
        self._bar.update(max(100.0 * progress.fraction - self._bar.n, 0.0))

    def _close(self, finished: bool) -> None:
        if self._bar is not None:
            if finished:
                self._bar.set_postfix_str("", refresh=False)
                self._bar.update(100.0 - self._bar.n)
            self._bar.close()
            self._bar = None
