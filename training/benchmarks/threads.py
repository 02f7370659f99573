# SPDX-License-Identifier: GPL-3.0-or-later
"""Single-threaded environment for every library: BLAS reads it when it is loaded, so it takes a process of its own."""

from __future__ import annotations

import os

_VARIABLES = (
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS"
)  # fmt: skip


def one_thread_environment() -> dict[str, str]:
    """This process's environment, with one thread for every library."""
    return os.environ | dict.fromkeys(_VARIABLES, "1")


def has_one_thread() -> bool:
    """Return whether this process was started in such an environment."""
    return all(os.environ.get(name) == "1" for name in _VARIABLES)
