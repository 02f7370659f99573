# SPDX-License-Identifier: GPL-3.0-or-later
"""Kernel that the tests of the engine process have called."""

from patchnet.patchnet_addon.runtime.kernels import kernel


@kernel
def total(values):  # type: ignore[no-untyped-def]
    found = 0.0
    for index in range(len(values)):
        found += values[index]
    return found
