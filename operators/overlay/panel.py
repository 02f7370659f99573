# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of the overlay in the sidebars of 3D viewport and Image Editor."""

from __future__ import annotations

import bpy

from ...patchnet_addon.runtime.quantities import named_list
from ..scene_access.images import unlike_view
from ..session.scene_session import session_of
from ..ui.tab import OVERLAY, PanelBase, draw_sentence, split
from .drawing import NO_VIEW
from .overlay_settings import overlay_settings, overlay_state


class _OverlayPanel(PanelBase):
    bl_region_type = "UI"
    bl_category = "PatchNet"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the switch, the pictures, the wipe, the inspection."""
        layout, values, state = split(self.layout), overlay_settings(context), overlay_state()
        switch = "show_viewport" if self.bl_space_type == "VIEW_3D" else "show_editor"
        on = getattr(values, switch)
        row = layout.row()
        row.use_property_split, row.enabled = False, on or bool(session_of(context.scene).views)
        row.prop(values, switch, icon="OVERLAY", toggle=True)
        if state.problem:
            draw_sentence(layout, context, state.problem, "ERROR")
        elif not session_of(context.scene).views:
            draw_sentence(layout, context, NO_VIEW, "INFO")
        elif on and not context.space_data.overlay.show_overlays:
            draw_sentence(layout, context, "Hidden by Show Overlays", "INFO")
        else:
            if on and switch == "show_viewport":
                _draw_how_to_see(layout, context)
            if unlike := unlike_view(context.scene):
                draw_sentence(layout, context, unlike, "INFO")
        column = layout.column()
        column.active = on
        for name in ("picture", "opacity", "legend", "use_wipe"):
            column.prop(values, name)
        wipe = column.column()
        wipe.active = values.use_wipe
        wipe.prop(values, "other")
        wipe.prop(values, "wipe")
        running = context.window is not None and context.window.as_pointer() in state.inspected
        layout.operator("patchnet.inspect_pixels", icon="EYEDROPPER", depress=running)


def _draw_how_to_see(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw which camera the viewport must look through to show a picture, unless it does."""
    space, cameras = context.space_data, list(session_of(context.scene).views)
    camera = space.camera if space.use_local_camera else context.scene.camera
    if camera is None or camera.name not in cameras:
        draw_sentence(layout, context, f"Pictures are of {named_list(cameras)}: make it the active camera", "INFO")
    elif space.region_3d.view_perspective != "CAMERA":
        draw_sentence(layout, context, f"Look through camera '{camera.name}' to see it (Numpad 0)", "INFO")
        row = layout.row()
        row.operator_context = "INVOKE_REGION_WIN"
        row.operator("view3d.view_camera", text="View Camera", icon="VIEW_CAMERA")


class PATCHNET_PT_overlay(_OverlayPanel, bpy.types.Panel):
    """The overlay in the camera's view."""

    bl_label = "Overlay"
    bl_space_type = "VIEW_3D"
    bl_parent_id = "PATCHNET_PT_main"
    bl_order = OVERLAY
    bl_options = {"DEFAULT_CLOSED"}


class PATCHNET_PT_image_overlay(_OverlayPanel, bpy.types.Panel):
    """The overlay over images."""

    bl_label = "Overlay"
    bl_space_type = "IMAGE_EDITOR"
