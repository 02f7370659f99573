# SPDX-License-Identifier: GPL-3.0-or-later
"""Log on stderr while something runs: lines for users, or one JSON object a line for programs.

An object has `time` (UTC), `level`, `event`, `message`, `seconds` since the start, and the fields of its event:

    start      command, and what it was given
    stage      a step begins: stage, fraction, frame
    progress   at most once a second: stage, fraction, frame, whole (share of all frames), seconds_left
    warning    something was assumed or left out
    result     what was made: file, frame, and figures
    error      what went wrong: exit_code, and the traceback of what should not have happened
    note       anything else
"""

from __future__ import annotations

import json
import logging
import os
import sys
import time
import traceback
from datetime import UTC, datetime
from typing import Any

from .errors import SettingError

LOG = logging.getLogger("patchnet")
TEXT, JSON = "text", "json"
FORMATS = (TEXT, JSON)
VARIABLE = "PATCHNET_LOG"

_SAID_OTHERWISE = ("start", "progress", "warning", "result", "error")  # to users: by bars, prints and reports
_began = time.monotonic()


def set_up(log_format: str | None = None, level: str = "WARNING") -> None:
    """Choose what is said: `log_format`, else that of the variable PATCHNET_LOG, else text; in text from `level` on.

    Raises SettingError for a format that there is not.
    """
    chosen = log_format or os.environ.get(VARIABLE) or TEXT
    if chosen not in FORMATS:
        if not _is_told():  # else logging itself would write what is said about it, a second time
            LOG.addHandler(_Lines(as_json=False))
        raise SettingError(
            f"There is no log format {chosen!r}: give {'--log-format' if log_format else VARIABLE} as "
            f"{' or '.join(FORMATS)}"
        )
    for handler in [handler for handler in LOG.handlers if isinstance(handler, _Lines)]:
        LOG.removeHandler(handler)
    if chosen == JSON or not _is_told():
        LOG.addHandler(_Lines(chosen == JSON))
    LOG.setLevel(level)
    if chosen == JSON:
        LOG.setLevel(min(LOG.level, logging.INFO))


def _is_told() -> bool:
    """Return whether a handler tells what is logged; one with an attribute `collects` only keeps it."""
    return any(not getattr(handler, "collects", False) for handler in LOG.handlers)


def is_json() -> bool:
    """Return whether programs read what is said."""
    return any(isinstance(handler, _Lines) and handler.as_json for handler in LOG.handlers)


def event(name: str, message: str, level: int = logging.INFO, /, **fields: Any) -> None:
    """Log that something happened; fields that are None are left out."""
    LOG.log(level, message, extra={"event": name, "fields": fields})


def start(command: str, **fields: Any) -> None:
    """Log that a command or an operator begins; seconds count from here."""
    global _began
    _began = time.monotonic()
    event("start", command, command=command, **fields)


def unexpected(error: BaseException, **fields: Any) -> None:
    """Log what should not have happened, with its traceback."""
    text = "".join(traceback.format_exception(error))
    event("error", f"{type(error).__name__}: {error}", logging.ERROR, traceback=text, **fields)


def json_line(name: str, message: str, level: int = logging.INFO, /, **fields: Any) -> str:
    """Format an event as a line of JSON, without the end of the line."""
    values = {
        "time": datetime.now(UTC).isoformat(timespec="milliseconds"),
        "level": logging.getLevelName(level).lower(),
        "event": name,
        "message": message,
        "seconds": round(time.monotonic() - _began, 3),
    }
    if taken := values.keys() & fields.keys():
        raise ValueError(f"{taken} are names that every event has")
    return json.dumps(values | {key: value for key, value in fields.items() if value is not None}, default=str)


class _Lines(logging.StreamHandler):  # type: ignore[type-arg]
    """Writer of lines to what stderr is at the moment."""

    def __init__(self, as_json: bool) -> None:
        super().__init__()
        self.as_json = as_json

    def emit(self, record: logging.LogRecord) -> None:
        self.stream = sys.stderr
        if self.as_json or getattr(record, "event", "") not in _SAID_OTHERWISE:
            super().emit(record)

    def format(self, record: logging.LogRecord) -> str:
        if not self.as_json:
            return super().format(record)
        name = getattr(record, "event", None) or _event_of(record.levelno)
        return json_line(name, record.getMessage(), record.levelno, **getattr(record, "fields", {}))


def _event_of(level: int) -> str:
    if level >= logging.ERROR:
        return "error"
    return "warning" if level >= logging.WARNING else "note"
