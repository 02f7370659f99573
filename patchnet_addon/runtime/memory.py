# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory of this process and of the system, as Linux states it."""

from __future__ import annotations

from contextlib import suppress


def resident_bytes() -> int | None:
    """Resident memory of this process in bytes; None except on Linux."""
    return system_bytes("/proc/self/status", "VmRSS")


def peak_bytes() -> int | None:
    """Peak of resident memory in bytes, since the start or the last reset of the kernel's counter."""
    return system_bytes("/proc/self/status", "VmHWM")


def system_bytes(file: str, name: str) -> int | None:
    """Value of a line of a file of Linux' /proc in bytes, or None."""
    with suppress(OSError), open(file, encoding="ascii", errors="replace") as lines:
        for line in lines:
            if line.startswith(f"{name}:"):
                return int(line.split()[1]) * 1024
    return None
