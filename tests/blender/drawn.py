# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw panels without a window: a layout that records texts, names and operators."""

from typing import Any

import bpy

from patchnet.operators import ui
from patchnet.operators.session import results
from patchnet.operators.session.scene_result import SceneResult
from patchnet.operators.ui import presets_menu
from patchnet.tests.blender.job_scene import SMALL


class Layout:
    """Stands in for Blender's layout; what hangs below it belongs to it."""

    def __init__(self, texts: list[str] | None = None) -> None:
        self.texts: list[str] = [] if texts is None else texts

    def panel(self, name: str, default_closed: bool = False) -> tuple["Layout", "Layout"]:
        """Header and body of a part that users close, which is open."""
        return Layout(self.texts), Layout(self.texts)

    def __getattr__(self, name: str) -> Any:
        def call(*args: object, **keywords: object) -> "Layout":
            self.texts.extend(str(value) for value in (*args, *keywords.values()) if isinstance(value, str))
            return Layout(self.texts)

        return call


def drawn(panel: type, **values: object) -> list[str]:
    """Drawing of a panel: labels, names of settings, identifiers of operators, icons. `values`: its own properties."""
    layout = Layout()
    panel.draw(type("Drawn", (), {"layout": layout, **values})(), bpy.context)
    return layout.texts


def everything() -> str:
    """Drawing of all panels: what they show."""
    classes = [item for item in ui.CLASSES if item is not presets_menu.PATCHNET_PT_presets]
    return "\n".join(text for item in classes for text in drawn(item))


def small_preview(**values: object) -> SceneResult:
    """Result of a small job by the button."""
    assert bpy.ops.patchnet.run_all(**{"light": "two-lights", "reference": True, **SMALL, **values}) == {"FINISHED"}
    return results.voxels_of(bpy.context.scene)
