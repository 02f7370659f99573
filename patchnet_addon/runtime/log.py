# SPDX-License-Identifier: GPL-3.0-or-later
"""Log on stderr: text lines for users, or one JSON object per line for programs.

An object has `time` (UTC), `level`, `event`, `message`, `seconds` since the start, and the fields of its event:

    start      command and its arguments
    stage      a step begins: stage, fraction, frame
    progress   at most once a second: stage, fraction, frame, whole (share of all frames), seconds_left
    warning    an assumption or an omission
    result     a result: file, frame, and figures
    error      a failure: exit_code, and the traceback of an unexpected error
    note       any other message
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

_SAID_OTHERWISE = ("start", "progress", "warning", "result", "error")  # shown otherwise: lines, prints, reports
_began = time.monotonic()


def set_up(log_format: str | None = None, level: str = "WARNING") -> None:
    """Set the log's format: `log_format`, else the variable PATCHNET_LOG, else text; text from `level` on.

    Raises SettingError for an unknown format.
    """
    chosen = log_format or os.environ.get(VARIABLE) or TEXT
    if chosen not in FORMATS:
        if not _is_told():  # otherwise Python's last-resort handler would print the error again
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
    """Return whether a handler prints records; one with an attribute `collects` only stores them."""
    return any(not getattr(handler, "collects", False) for handler in LOG.handlers)


def is_json() -> bool:
    """Return whether the log is JSON lines."""
    return any(isinstance(handler, _Lines) and handler.as_json for handler in LOG.handlers)


def event(name: str, message: str, level: int = logging.INFO, /, **fields: Any) -> None:
    """Log an event; fields that are None are omitted."""
    LOG.log(level, message, extra={"event": name, "fields": fields})


def start(command: str, **fields: Any) -> None:
    """Log the start of a command or an operator, from which `seconds` count."""
    global _began
    _began = time.monotonic()
    event("start", command, command=command, **fields)


def unexpected(error: BaseException, **fields: Any) -> None:
    """Log an unexpected error with its traceback."""
    text = "".join(traceback.format_exception(error))
    event("error", f"{type(error).__name__}: {error}", logging.ERROR, traceback=text, **fields)


def omitted(error: BaseException, message: str) -> None:
    """Log a warning about an unexpected error that a job goes on after, with its traceback."""
    text = "".join(traceback.format_exception(error))
    LOG.warning(message, exc_info=error, extra={"fields": {"traceback": text}})


def json_line(name: str, message: str, level: int = logging.INFO, /, **fields: Any) -> str:
    """Format an event as a line of JSON without a newline."""
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


class _Lines(logging.StreamHandler):
    """Handler that writes to the present stderr."""

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
