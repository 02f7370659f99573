# SPDX-License-Identifier: GPL-3.0-or-later
"""Environment of so many threads for every library: for a process of its own, as BLAS reads it when it is loaded."""

from __future__ import annotations

import os

_VARIABLES = (
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS"
)  # fmt: skip


def environment_of_threads(threads: int) -> dict[str, str]:
    """This process's environment, with so many threads for every library."""
    return os.environ | dict.fromkeys(_VARIABLES, str(threads))


def has_threads(threads: int) -> bool:
    """Return whether this process was started in such an environment."""
    return all(os.environ.get(name) == str(threads) for name in _VARIABLES)
