# SPDX-License-Identifier: GPL-3.0-or-later
"""Notes on what a job left out or shows only about, and advice, with buttons that do what they say."""

from __future__ import annotations

from collections.abc import Sequence

import bpy

from ....patchnet_addon.runtime.quantities import counted
from ...schema.named import named_settings
from ...schema.setting import Kind
from ...settings.cycles_settings import COMBINED
from .tab import draw_sentence

_MOST = 5


def draw_notes(layout: bpy.types.UILayout, context: bpy.types.Context, notes: Sequence[str], of: str) -> None:
    """Draw notes below a heading that closes and opens them; none for none. of: what they are notes of, its name."""
    if not notes:
        return
    header, body = layout.panel(f"PATCHNET_notes_{of}")
    header.label(text=counted(len(notes), "Note"), icon="INFO")
    if body is None:
        return
    notes = sorted(notes, key=lambda text: not named_settings(text))  # those first that a button helps
    for text in notes[:_MOST]:
        draw_todo(body.box(), context, text, "NONE")
    if len(notes) > _MOST:
        draw_sentence(body, context, f"and {len(notes) - _MOST} more in the Info log")
    if any("Refine with Cycles" in text for text in notes[:_MOST]):
        body.operator("patchnet.refine_with_cycles", icon="RENDER_STILL").cycles_light = COMBINED


def draw_todo(layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str) -> None:
    """Draw a sentence, and a button for each setting that it names, unless that has the value already."""
    draw_sentence(layout, context, text, icon)
    for words, (row, value) in named_settings(text).items():
        if getattr(context.scene.patchnet, row.name) != value:
            button = layout.operator(f"wm.context_set_{'enum' if row.kind is Kind.CHOICE else 'boolean'}", text=words)
            button.data_path, button.value = f"scene.patchnet.{row.name}", value
