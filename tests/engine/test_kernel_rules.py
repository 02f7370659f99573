# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules for kernels that numba does not check."""

import importlib

import pytest
from numba.core.registry import CPUDispatcher

from patchnet.patchnet_addon.runtime import kernels
from patchnet.patchnet_addon.surface import polygon
from patchnet.patchnet_addon.tracing.tile import ray_of


def test_python_cannot_call_a_device_function():
    """It has no code for that: a call would end the process."""
    with pytest.raises(TypeError, match="ray_of is a device function: call it from a kernel, or its py_func"):
        ray_of(1, 2)
    assert ray_of.py_func(4, 4) == 48


def test_compiled_functions_have_names_of_their_own():
    """Those of two processes in the cache are linked by name: functions made by one line would be taken for another."""
    names = {}
    for name in kernels._with_kernels():
        try:
            module = importlib.import_module(f"patchnet.{name}")
        except ModuleNotFoundError as missing:
            if missing.name != "torch":
                raise
            continue  # training, which is not done here
        for value in vars(module).values():
            if isinstance(value, CPUDispatcher):
                function = value.py_func
                assert "<locals>" not in function.__qualname__
                cells = tuple(cell.cell_contents for cell in function.__closure__ or ())
                key = function.__module__, function.__qualname__
                assert names.setdefault(key, (function.__code__, cells)) == (function.__code__, cells)
    splits = polygon.split_x, polygon.split_y, polygon.split_z
    assert len({split.py_func.__qualname__ for split in splits}) == 3
