# SPDX-License-Identifier: GPL-3.0-or-later
"""Bytes and counts in words, so that a small one is never said to be 0.0 of something."""

from __future__ import annotations


def bytes_text(number: float) -> str:
    """Bytes in words, such as 1.5 GiB, 1.0 MiB, 12.0 KiB, 5 B."""
    for limit, unit in ((2**30, "GiB"), (2**20, "MiB"), (2**10, "KiB")):
        if number >= limit:
            return f"{number / limit:.1f} {unit}"
    return f"{number:.0f} B"


def count_text(number: float) -> str:
    """Count in words, such as 2.5 G, 1.3 M, 12,345."""
    for limit, unit in ((1e9, " G"), (1e6, " M")):
        if number >= limit:
            return f"{number / limit:.1f}{unit}"
    return f"{number:,.0f}"
