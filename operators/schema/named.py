# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings that a sentence names as "Label: Value", as a window does: what buttons set, and flags of the command line.

So a sentence is written once, in the words of a window; `with_flags` is what commands say.
"""

from __future__ import annotations

import re
from typing import Any

from .setting import Kind, Setting
from .table import TABLE

_VALUES = {Kind.SWITCH: ((True, "On", ""), (False, "Off", ""))}
_NAMED: dict[str, tuple[Setting, Any]] = {
    f"{row.label}: {label}": (row, value)
    for row in TABLE.values()
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
        argument = row.argument or ("--strategy" if row.name == "strategy" else "")
        switch = argument if value else f"--no-{argument[2:]}"
        flag = switch if row.kind is Kind.SWITCH else f"{argument} {value}"
        return f"{match[0]} ({flag})" if argument else match[0]

    # --device means more than the row.
    return _WORDS.sub(flagged, text).replace("(Network Device)", "(Network Device, --device)")
