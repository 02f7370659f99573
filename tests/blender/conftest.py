# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests with Blender as a Python module end their process like the command does: see `patchnet.__main__.leave`."""

import sys

import pytest

from patchnet.__main__ import leave

_status = pytest.StashKey[int]()


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """Remember the exit status for the very end."""
    session.config.stash[_status] = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    """Leave without unloading Blender, which may hang; pytest has printed its closing line by now."""
    if "bpy" in sys.modules and _status in config.stash:
        leave(config.stash[_status])
