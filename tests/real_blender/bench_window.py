# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures of a job in a window, which nothing judges: `pytest -s tests/real_blender/bench_window.py`.

Times of a first job, which compiles kernels, and of a second one; memory of Blender's process; the longest gaps
between two events of a timer, with the labels of the job before and after them, beside those of a window that is drawn
again and again, of Blender's own render and bake, and of a job in a window that shows no viewport; what our engine
takes of a frame of the viewport.
"""

import json
from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import Blender


@pytest.mark.parametrize("name", ["cold", "warm"])
def test_window(name: str, installed: Blender, courtyard: Path, out: Path) -> None:
    found = installed.visit(name, out, name, "9", file=courtyard, script="smooth", seconds=1500.0)
    print(json.dumps({key: value for key, value in found.items() if key != "said"}, indent=1))
    assert found["job"]["longest_ms"] > 0.0
