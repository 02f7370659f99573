# SPDX-License-Identifier: GPL-3.0-or-later
"""Wording of sentences for users."""

from __future__ import annotations

from collections.abc import Iterable


def named_list(names: Iterable[str], most: int = 5) -> str:
    """Quote distinct names with commas between, "" leaving out: 'a', 'b' and 3 more; empty for none."""
    listed = [f"'{name}'" for name in dict.fromkeys(names) if name]
    return ", ".join(listed[:most]) + (f" and {len(listed) - most} more" if len(listed) > most else "")
