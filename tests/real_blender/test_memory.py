# SPDX-License-Identifier: GPL-3.0-or-later
"""Check the report of memory_window.py: memory goes back to the system."""

from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import Blender

MB = 2**20
KEPT_BYTES = 300_000_000  # by Blender itself


@pytest.fixture(scope="module")
def memory(installed: Blender, courtyard: Path, out: Path) -> dict:
    """Report of memory_window.py."""
    seen = installed.visit("memory", out, file=courtyard)
    assert "Baking light" in seen["steps"]
    return seen


def test_kernels_are_compiled_in_another_process(memory: dict) -> None:
    assert memory["engine"] and memory["compilers"] == []


def test_panel_states_what_is_held(memory: dict) -> None:
    assert memory["start"]["results"] == memory["start"]["images"] == memory["freed"]["results"] == 0
    assert memory["job"]["results"] > 10 * MB and memory["job"]["images"] > MB
    assert memory["viewport"]["process"] - memory["freed"]["process"] > memory["viewport"]["results"]


def test_freed_memory_goes_back_to_the_system(memory: dict) -> None:
    assert memory["freed"]["process"] - memory["rendered by Cycles"]["process"] < KEPT_BYTES
