# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings that a sentence names as "Label: Value", as a window does: what buttons set, and flags of the command line.

So a sentence is written once, in the words of a window; `with_flags` is what commands say.
"""

from __future__ import annotations

import re
from typing import Any

from ..schema.setting import Kind, Setting
from ..schema.values import JOB, RENDERS
from .job_settings import rows

_VALUES = {Kind.SWITCH: ((True, "On", ""), (False, "Off", ""))}
_NAMED: dict[str, tuple[Setting, Any]] = {
    f"{row.label}: {label}": (row, value)
    for row in rows(*JOB, RENDERS)
    for value, label, _ in row.choices or _VALUES.get(row.kind, ())
}
_WORDS = re.compile("|".join(re.escape(words) for words in sorted(_NAMED, key=len, reverse=True)))


def named_settings(text: str) -> dict[str, tuple[Setting, Any]]:
    """Settings that a sentence names, and the values that it gives them, by the words in it."""
    return {words: _NAMED[words] for words in _WORDS.findall(text)}


def with_flags(text: str) -> str:
    """Add to each setting that a sentence names the flag of the command line: "Gloss: Automatic (--gloss auto)"."""

    def flagged(match: re.Match[str]) -> str:
        row, value = _NAMED[match[0]]
        switch = row.flag if value else f"--no-{row.flag[2:]}"
        flag = switch if row.kind is Kind.SWITCH else f"{row.flag} {str(value).lower()}"
        return f"{match[0]} ({flag})" if row.flag else match[0]

    # --device means more than the row.
    return _WORDS.sub(flagged, text).replace("(Network Device)", "(Network Device, --device)")
