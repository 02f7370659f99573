# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules for kernels that numba does not check."""

import pytest

from patchnet.patchnet_addon.tracing.tile import ray_of


def test_python_cannot_call_a_device_function():
    """It has no code for that: a call would end the process."""
    with pytest.raises(TypeError, match="ray_of is a device function: call it from a kernel, or its py_func"):
        ray_of(1, 2)
    assert ray_of.py_func(4, 4) == 48
