# SPDX-License-Identifier: GPL-3.0-or-later
"""Value of a setting: what an operator's caller gave, else the scene's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ....patchnet_addon.runtime.errors import SettingError
from ...scene_access.unread_file import check_opened


def setting(context: bpy.types.Context, operator: bpy.types.Operator, name: str) -> Any:
    """Value of a setting: the operator's property if its caller set it, else the scene's."""
    return getattr(operator if is_given(operator, name) else context.scene.patchnet, name)


def is_given(operator: bpy.types.Operator, name: str) -> bool:
    """Return whether the operator has this property and its caller set it."""
    values = operator.properties
    return name in values.bl_rna.properties and values.is_property_set(name)


def absolute_path(text: str) -> Path | None:
    """Absolute path of a text that may begin with // for the folder of the .blend file; None for an empty one.

    Raises SettingError, or SceneError, if there is no such folder.
    """
    if not text:
        return None
    if text.startswith("//") and not bpy.data.filepath:
        check_opened()
        raise SettingError(f"Path '{text}' is relative to the .blend file: save the file first")
    return Path(bpy.path.abspath(text)).absolute()
