# SPDX-License-Identifier: GPL-3.0-or-later
"""Render engine class (`bpy.types.RenderEngine`) as Blender calls it."""

from __future__ import annotations

from contextlib import suppress

import bpy

from ...patchnet_addon.runtime.errors import FilesGoneError, PatchNetError, StoppedError
from .passes import BY_PRIORITY, PASSES

ENGINE = "PATCHNET"


class PatchNetRenderEngine(bpy.types.RenderEngine):
    """Render from the octree with one ray per pixel, and many where look-ahead predicts an error"""

    bl_idname = ENGINE
    bl_label = "PatchNet"
    bl_use_preview = False
    bl_use_postprocess = True
    bl_use_eevee_viewport = True  # for Material Preview
    bl_use_shading_nodes_custom = False

    warnings = ()  # of the frame
    _viewport = None  # no annotation: Blender 4.5 evaluates the names in annotations of its classes

    def __del__(self) -> None:
        """Keep the drawn picture for the viewport's next engine, which may start at once."""
        with suppress(ReferenceError):  # Blender has already removed its part, as on quitting
            if self._viewport is not None:
                from .viewport import leave

                leave(self._viewport)

    def update_render_passes(self, scene: bpy.types.Scene = None, renderlayer: bpy.types.ViewLayer = None) -> None:
        """Register the passes for the compositor."""
        ranked = not scene.patchnet.render_samples
        for item in (each for each in PASSES if ranked or each.name not in BY_PRIORITY):
            self.register_pass(scene, renderlayer, item.name, len(item.channels), item.channels, item.kind)

    def render(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Render a frame of a final render."""
        try:
            from .render_frame import render_frame

            render_frame(self, depsgraph)
        except StoppedError:
            pass  # stopped by the user
        except PatchNetError as error:
            self._fail(str(error))
        except ImportError as error:
            gone = FilesGoneError.of(error)
            if gone is None:
                raise
            self._fail(str(gone))
        except MemoryError:
            self._fail("The render ran out of memory: choose fewer pixels or a smaller depth")

    def view_update(self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        """Note a change of scene or settings; `view_draw` detects the changes, except those of painted weights."""
        if self._viewport is not None:
            self._viewport.updated(depsgraph)
        self.tag_redraw()

    def view_draw(self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        """Draw a viewport in this engine's shading mode."""
        from .viewport import Viewport, left_in

        if self._viewport is None:
            self._viewport = left_in(context.region) or Viewport()
        self._viewport.draw(self, context, depsgraph)

    def _fail(self, sentence: str) -> None:
        """Report the sentence in the status bar and the render window; scripts get an exception."""
        self.report({"ERROR"}, sentence)
        self.error_set(sentence)
