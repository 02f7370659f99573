# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet octree`: settings that contradict each other."""

import pytest

from patchnet.commands import main


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--depth", "fit"], "--view"),
        (["--depth", "7", "--view", "1", "0", "0", "0", "0", "0"], "--view"),
        (["--depth", "deep"], "'deep'"),
        (["--depth", "fit", "--view", "1", "0", "0", "0", "0", "0", "--rotate", "3"], "--rotate"),
        (["--depth", "fit", "--view", "1", "0", "0", "0", "0", "0", "--memory", "0"], "--memory"),
        (["--depth", "5", "--bisect", "w", "0.5"], "--bisect w is no axis"),
        (["--depth", "5", "--bisect", "x", "1.5"], "--bisect"),
        (["--depth", "5", "--bisect", "x", "0.5", "--rotate", "3"], "--rotate"),
        (["--depth", "fit", "--view", "1", "0", "0", "0", "0", "0", "--bisect", "x", "0.5"], "--depth fit"),
    ],
)
def test_octree_settings_that_contradict_each_other(words, said, capfd):
    assert main(["octree", "none.obj", "--out", "none.safetensors", *words]) == 2
    assert said in capfd.readouterr().err
