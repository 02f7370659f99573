# SPDX-License-Identifier: GPL-3.0-or-later
"""Devices for tests of torch: the CPU, and a GPU where there is one, else a skip that says so."""

import pytest

from patchnet.patchnet_addon.network.devices import torch_has_gpu

GPU = (pytest.mark.gpu, pytest.mark.skipif(not torch_has_gpu(), reason="no GPU here"))
DEVICES = ["cpu", pytest.param("cuda", marks=GPU)]


def gpu_only(test):
    """Mark a test that needs a GPU."""
    for mark in GPU:
        test = mark(test)
    return test
