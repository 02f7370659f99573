# SPDX-License-Identifier: GPL-3.0-or-later
"""Human-readable sizes, counts and lists of names."""

from __future__ import annotations

from collections.abc import Iterable

_NAMED = 5  # names of a list at most


def bytes_text(number: float) -> str:
    """Human-readable size, such as 1.5 GiB, 1.0 MiB, 12.0 KiB, 5 B."""
    for limit, unit in ((2**30, "GiB"), (2**20, "MiB"), (2**10, "KiB")):
        if number >= limit:
            return f"{number / limit:.1f} {unit}"
    return f"{number:.0f} B"


def count_text(number: float) -> str:
    """Human-readable count, such as 2.5 G, 1.3 M, 12,345."""
    for limit, unit in ((1e9, " G"), (1e6, " M")):
        if number >= limit:
            return f"{number / limit:.1f}{unit}"
    return f"{number:,.0f}"


def counted(number: int, noun: str) -> str:
    """Count with its noun: 1 view, 2,000 views."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def error_text(mse: float) -> str:
    """Mean squared error times 10,000, the unit of all errors shown to users: 404, 24.7, 0.031."""
    value = 1e4 * mse
    return f"{value:.0f}" if value >= 100.0 else f"{value:.1f}" if value >= 1.0 or not value else f"{value:.2g}"


def subject(kind: str, names: Iterable[str]) -> str:
    """Subject of a sentence about named things: "Material 'a' is", "Materials 'a', 'b' are"; empty for none."""
    distinct = list(dict.fromkeys(name for name in names if name))
    one, verb = (kind, "is") if len(distinct) == 1 else (f"{kind}s", "are")
    return f"{one} {named_list(distinct)} {verb}" if distinct else ""


def named_list(names: Iterable[str]) -> str:
    """Quoted distinct names without "": 'a', 'b' and 3 more; empty for none."""
    listed = [f"'{name}'" for name in dict.fromkeys(names) if name]
    return ", ".join(listed[:_NAMED]) + (f" and {len(listed) - _NAMED} more" if len(listed) > _NAMED else "")
