# SPDX-License-Identifier: GPL-3.0-or-later
"""Wording of sentences for users."""

from __future__ import annotations

from collections.abc import Iterable


def named_list(names: Iterable[str], most: int = 5) -> str:
    """Quote distinct names with commas between, "" leaving out: 'a', 'b' and 3 more; empty for none."""
    listed = [f"'{name}'" for name in dict.fromkeys(names) if name]
    return ", ".join(listed[:most]) + (f" and {len(listed) - most} more" if len(listed) > most else "")


def named_are(noun: str, names: Iterable[str]) -> str:
    """Begin a sentence about named things: Material 'a' is, Materials 'a', 'b' are; empty for none."""
    names = [name for name in dict.fromkeys(names) if name]
    ending, verb = ("", "is") if len(names) == 1 else ("s", "are")
    return f"{noun}{ending} {named_list(names)} {verb}" if names else ""
