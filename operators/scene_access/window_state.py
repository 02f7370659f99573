# SPDX-License-Identifier: GPL-3.0-or-later
"""State of the window: one object from registration to unregistration, with a part for each package that needs one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

import bpy

Kind = TypeVar("Kind")
_NAME = "patchnet_window"  # attribute of `bpy.types.WindowManager`


class WindowState:
    """Object whose attributes are the parts by name."""


class Part(Generic[Kind]):
    """Part of the window's state, made by `make` when it is first asked for, which is by a call.

    Without registration, as in a command, nothing keeps what is made.
    """

    def __init__(self, name: str, make: Callable[[], Kind]) -> None:
        self._name, self._make = name, make

    def __call__(self) -> Kind:
        state = getattr(bpy.types.WindowManager, _NAME, None)
        if state is None:
            return self._make()
        if not hasattr(state, self._name):
            vars(state).setdefault(self._name, self._make())  # a render's thread may ask, too
        found: Kind = getattr(state, self._name)
        return found


def register() -> None:
    """Make the state, before anything is registered that asks for it."""
    setattr(bpy.types.WindowManager, _NAME, WindowState())


def unregister() -> None:
    """Drop the state with all parts."""
    delattr(bpy.types.WindowManager, _NAME)
