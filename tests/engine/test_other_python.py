# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoding in another Python: the same codes, and sentences where it cannot."""

import os
import sys
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from patchnet.patchnet_addon.network.array_stream import read_array, write_array
from patchnet.patchnet_addon.network.other_python import OtherPythonEncoder, ask_python
from patchnet.patchnet_addon.network.weights import Weights
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.tests.references.networks import NumpyEncoder

PYTHON = Path(sys.executable)


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    """This Python without any package."""
    path = tmp_path / "bare"
    path.write_text(f'#!/bin/sh\nexec "{sys.executable}" -I -S "$@"\n')
    path.chmod(0o755)
    return path


def chunk(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    blocks = rng.random((7, 320), np.float32)
    blocks[0] = 0.0
    return blocks, rng.integers(0, 7, (11, 8))


def test_arrays_through_a_stream() -> None:
    stream = BytesIO()
    arrays = [np.arange(6, dtype=np.float32).reshape(2, 3), np.zeros((0, 4), np.int64), np.array(5)]
    for array in arrays:
        write_array(stream, array)
    stream.seek(0)
    for array in arrays:
        got = read_array(stream)
        assert got.dtype == array.dtype
        np.testing.assert_array_equal(got, array)
    with pytest.raises(EOFError):
        read_array(stream)
    with pytest.raises(EOFError, match="within"):
        read_array(BytesIO(stream.getvalue()[:30]))


def test_codes_are_those_of_numpy() -> None:
    pytest.importorskip("torch")
    weights = Weights.random(3, bias=0.1)
    with OtherPythonEncoder(PYTHON, weights, "cpu") as other:
        assert other.said["device"] == "cpu" and other.chunk > 0
        for seed in range(2):
            np.testing.assert_allclose(other(*chunk(seed)), NumpyEncoder(weights)(*chunk(seed)), atol=1e-4)
        process = other._process
    assert process.poll() is not None


def test_what_it_says_about_itself() -> None:
    torch = pytest.importorskip("torch")
    assert torch.__version__ in ask_python(PYTHON)


def test_python_without_torch(bare: Path) -> None:
    if os.name == "nt":
        pytest.skip("a shell script")
    with pytest.raises(SettingError, match=r"has no torch .*No module named 'torch'"):
        ask_python(bare)
    with pytest.raises(SettingError, match="cannot encode"):
        OtherPythonEncoder(bare, Weights.random(3))


def test_no_python_at_all(tmp_path: Path) -> None:
    nothing = tmp_path / "nothing"
    with pytest.raises(SettingError, match="cannot be run"):
        OtherPythonEncoder(nothing, Weights.random(3))
    with pytest.raises(SettingError, match="cannot be run"):
        ask_python(nothing)


def test_process_that_dies_on_the_way() -> None:
    pytest.importorskip("torch")
    with OtherPythonEncoder(PYTHON, Weights.random(3), "cpu") as other:
        other._process.kill()
        other._process.wait()
        with pytest.raises(SettingError, match="cannot encode"):
            other(*chunk())
