# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawing of pixels and text in a 3D viewport; `gpu` needs a window, so it is imported where it draws."""

from __future__ import annotations

import bpy
import numpy as np

_TEXT_PX = 15
_MARGIN_PX = 20


class PictureTexture:
    """Picture on the graphics card, freed with this object."""

    def __init__(self, pixels: np.ndarray) -> None:
        """Upload pixels (H, W, 4) float32, scene-linear, weighed by alpha."""
        import gpu

        self.height_px, self.width_px = pixels.shape[:2]
        data = gpu.types.Buffer("FLOAT", pixels.size, np.ascontiguousarray(pixels).ravel())
        self._texture = gpu.types.GPUTexture((self.width_px, self.height_px), format="RGBA16F", data=data)

    def draw(self, engine: bpy.types.RenderEngine, scene: bpy.types.Scene) -> None:
        """Fill the region that is being drawn; Blender applies the scene's view transform afterwards."""
        import gpu
        from gpu_extras.presets import draw_texture_2d

        gpu.state.blend_set("ALPHA_PREMULT")
        engine.bind_display_space_shader(scene)
        draw_texture_2d(self._texture, (0, 0), self.width_px, self.height_px)
        engine.unbind_display_space_shader()
        gpu.state.blend_set("NONE")


def draw_message(region: bpy.types.Region, text: str) -> None:
    """Draw a sentence in the middle of the region."""
    import blf

    font = 0
    size = min(_TEXT_PX * bpy.context.preferences.system.ui_scale, 1.8 * (region.width - 2 * _MARGIN_PX) / len(text))
    blf.size(font, max(size, 8))
    width, _ = blf.dimensions(font, text)
    blf.color(font, 0.9, 0.9, 0.9, 1.0)
    blf.position(font, max((region.width - width) / 2, _MARGIN_PX), region.height / 2, 0)
    blf.draw(font, text)
