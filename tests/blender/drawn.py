# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw panels without a window: a layout that records texts, names and operators."""

from typing import Any

import bpy

from patchnet.operators import ui
from patchnet.operators.session import results
from patchnet.operators.session.scene_result import SceneResult
from patchnet.operators.settings.job_settings import TABLE
from patchnet.operators.ui import presets_menu
from patchnet.tests.blender.job_scene import run_small


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


TABS = [item for item in ui.CLASSES if item is not presets_menu.PATCHNET_PT_presets]


def everything() -> str:
    """Drawing of all panels: what they show."""
    return "\n".join(text for item in TABS for text in drawn(item))


def settings_drawn(panel: type) -> set[str]:
    """Names of the scene's settings that a panel draws, whatever is chosen in others."""
    values, found = bpy.context.scene.patchnet, set()
    for chosen in ("light", "resolution", "importance"):
        for value, _, _ in TABLE[chosen].choices:
            setattr(values, chosen, value)
            found |= set(drawn(panel)) & {*values.bl_rna.properties.keys(), "frame_start", "frame_end", "frame_step"}
        values.property_unset(chosen)
    return found


def small_preview(**values: object) -> SceneResult:
    """Result of a small job by the button."""
    run_small(**{"reference": True, **values})
    return results.voxels_of(bpy.context.scene)
