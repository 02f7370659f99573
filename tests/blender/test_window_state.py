# SPDX-License-Identifier: GPL-3.0-or-later
"""The window's state from registration to unregistration, and leftovers of the extension in Blender."""

import gc
import sys
from collections.abc import Iterator
from pathlib import Path
from weakref import ref

import bpy
import pytest

import patchnet
from patchnet.operators import registration
from patchnet.operators.jobs.job_operator import job_in_window
from patchnet.operators.overlay.overlay_settings import overlay_state
from patchnet.operators.session import results
from patchnet.operators.session.scene_session import session_of
from patchnet.tests.blender.job_scene import SMALL, build

sys.path.insert(0, str(Path(patchnet.__file__).parent / ".ci"))
from extension_traces import traces

TIMERS = [timer for module in registration._MODULES for timer in getattr(module, "TIMERS", ())]


@pytest.fixture
def unregistered() -> Iterator[None]:
    """The extension is unregistered before and after the test."""
    assert not traces()
    yield
    if traces():
        patchnet.unregister()


def test_nothing_remains_after_unregistration(unregistered: None, weights: Path) -> None:
    """After a job and with all timers: neither state nor anything in Blender; twice the same at the start."""
    begun = []
    for _ in range(2):
        patchnet.register()
        begun.append(traces())
        build()
        scene = bpy.context.scene
        scene.patchnet.weights = str(weights)
        assert results.result_of(scene) is None and overlay_state() is overlay_state()
        assert bpy.ops.patchnet.run_all(light="two-lights", **SMALL) == {"FINISHED"}
        overlay_state().problem = "it broke"
        left = [ref(part) for part in (overlay_state(), job_in_window(), results.result_of(scene))]
        for timer in TIMERS:
            if not bpy.app.timers.is_registered(timer):
                bpy.app.timers.register(timer, first_interval=600.0)
        patchnet.unregister()
        gc.collect()
        assert [part() for part in left] == [None] * len(left)
        assert not any(map(bpy.app.timers.is_registered, TIMERS)) and not traces()
    assert begun[0] == begun[1] and "WindowManager.patchnet_window" in begun[0]["properties"]


def test_without_registration_nothing_is_kept(unregistered: None) -> None:
    """Commands use modules of the extension without it."""
    build()
    session = session_of(bpy.context.scene)
    session.looked = True
    assert not session_of(bpy.context.scene).looked and job_in_window().title == ""


def test_state_outlives_files_but_what_is_kept_of_scenes_does_not(registered: None) -> None:
    build()
    state = overlay_state()
    session_of(bpy.context.scene).looked = True
    bpy.ops.wm.read_homefile(use_empty=True)
    assert overlay_state() is state and not session_of(bpy.context.scene).looked
