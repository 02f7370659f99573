# SPDX-License-Identifier: GPL-3.0-or-later
"""Fixtures of several groups of tests; imports neither PatchNet nor Blender itself."""

import signal
from collections.abc import Iterator

import pytest


@pytest.fixture
def ctrl_c() -> Iterator[None]:
    """Ctrl-C as in a terminal: what runs in the background was started deaf to it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def text_log() -> Iterator[None]:
    """The log is text again after the test."""
    from patchnet.patchnet_addon.runtime import log

    yield
    log.set_up(log.TEXT)
