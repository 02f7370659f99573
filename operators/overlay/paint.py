# SPDX-License-Identifier: GPL-3.0-or-later
"""Rectangles, ramps, textures and text in the pixels of a region, in sRGB colours as Blender's own text.

`gpu` and `blf` need a window, so they are imported where something is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any

import numpy as np

from ..scene_access.window_state import Part
from ..session.shown_view import ShownView
from .framed import Rect

Color = tuple[float, float, float, float]
INK: Color = (0.92, 0.92, 0.92, 1.0)
WARNING: Color = (1.0, 0.72, 0.25, 1.0)
GROUND: Color = (0.06, 0.06, 0.06, 0.82)
_FONT = 0
_TEXT_PX = 11
# Regions that are drawn in linear light are shown with a gamma of 2.2, not with the transfer function of sRGB.
_PICTURE_SOURCE = """
void main()
{
  vec2 texel = at * vec2(textureSize(image, 0));
  vec4 blurred = texture(image, at);
  vec4 square = texelFetch(image, clamp(ivec2(floor(texel)), ivec2(0), textureSize(image, 0) - 1), 0);
  bool magnified = max(fwidth(texel.x), fwidth(texel.y)) <= 1.0;
  vec4 shown = magnified ? square : blurred;
  color = vec4(srgbTarget ? pow(shown.rgb, vec3(2.2)) : shown.rgb, opacity * shown.a);
}
"""


class Textures:
    """Textures (gpu.types.GPUTexture) of views and the shader for pictures, made when they are first drawn."""

    def __init__(self) -> None:
        self.of_view = lru_cache(maxsize=6)(_texture_of)  # two sides of a wipe in three editors
        self.shader = cache(_picture_shader)

    def free(self) -> None:
        """Free their memory on the graphics card."""
        self.of_view.cache_clear()
        self.shader.cache_clear()


textures = Part("textures", Textures)


def _texture_of(view: ShownView, name: str, maximum: float, ramp: str) -> Any:
    return uploaded(view.picture(name, maximum, ramp))


def texels(picture: np.ndarray) -> np.ndarray:
    """Texels (H, W, 4) float32 of sRGB colours (H, W, 3), opaque, or with straight alpha (H, W, 4)."""
    opaque = np.ones((*picture.shape[:2], 4 - picture.shape[-1]), np.float32)  # no column if there is alpha
    return np.concatenate([picture, opaque], axis=-1, dtype=np.float32)


def uploaded(picture: np.ndarray) -> Any:
    """Upload sRGB colours as a texture, see `texels`."""
    return texture(texels(picture), "RGBA8")


def texture(pixels: np.ndarray, kind: str) -> Any:
    """Texture of pixels (H, W, 4) float32, in one of Blender's formats."""
    import gpu

    data = gpu.types.Buffer("FLOAT", pixels.size, np.ascontiguousarray(pixels).ravel())
    return gpu.types.GPUTexture((pixels.shape[1], pixels.shape[0]), format=kind, data=data)


def fill(rect: Rect, color: Color) -> None:
    """Draw a rectangle of one colour."""
    ramp(rect, [color, color])


def ramp(rect: Rect, colors: Sequence[Color]) -> None:
    """Draw a bar of colours from left to right."""
    import gpu

    places = np.linspace(rect.left, rect.right, len(colors)).tolist()
    points = [(x, y, 0.0) for x in places for y in (rect.bottom, rect.top)]
    _draw_strip(gpu.shader.from_builtin("SMOOTH_COLOR"), pos=points, color=[shade for shade in colors for _ in "yy"])


def picture(texture: Any, whole: Rect, seen: Rect, opacity: float) -> None:
    """Draw the part `seen` of a texture that covers `whole`; where it is magnified, its pixels are squares."""
    import gpu

    if seen.empty:
        return
    points = [(x, y) for y in (seen.bottom, seen.top) for x in (seen.left, seen.right)]
    places = [((x - whole.left) / whole.width, (y - whole.bottom) / whole.height) for x, y in points]
    uniforms = {"matrix": gpu.matrix.get_projection_matrix() @ gpu.matrix.get_model_view_matrix(), "opacity": opacity}
    shader = textures().shader()
    shader.bind()
    shader.uniform_sampler("image", texture)
    for name, value in uniforms.items():
        shader.uniform_float(name, value)
    _draw_strip(shader, pos=points, place=places)


def _draw_strip(shader: Any, **attributes: Sequence[tuple[float, ...]]) -> None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    gpu.state.blend_set("ALPHA")
    batch_for_shader(shader, "TRI_STRIP", attributes).draw(shader)
    gpu.state.blend_set("NONE")


def _picture_shader() -> Any:
    """Shader for pictures; Blender's image shader blurs them, which no texture setting changes before Blender 5."""
    import gpu

    passed = gpu.types.GPUStageInterfaceInfo("patchnet_overlay")
    passed.smooth("VEC2", "at")
    info = gpu.types.GPUShaderCreateInfo()
    info.push_constant("MAT4", "matrix")
    info.push_constant("FLOAT", "opacity")
    info.push_constant("BOOL", "srgbTarget")  # Blender sets it
    info.sampler(0, "FLOAT_2D", "image")
    info.vertex_in(0, "VEC2", "pos")
    info.vertex_in(1, "VEC2", "place")
    info.vertex_out(passed)
    info.fragment_out(0, "VEC4", "color")
    info.vertex_source("void main() { at = place; gl_Position = matrix * vec4(pos, 0.0, 1.0); }")
    info.fragment_source(_PICTURE_SOURCE)
    return gpu.shader.create_from_info(info)


def text_size(text: str, scale: float) -> tuple[float, float]:
    """Width and line height of a text in pixels; scale: of the user's display."""
    import blf

    blf.size(_FONT, _TEXT_PX * scale)
    return blf.dimensions(_FONT, text)[0], _TEXT_PX * scale * 1.35


def write(text: str, x: float, y: float, scale: float, color: Color = INK) -> None:
    """Draw a line of text with its baseline at y."""
    import blf

    blf.size(_FONT, _TEXT_PX * scale)
    blf.color(_FONT, *color)
    blf.position(_FONT, x, y, 0.0)
    blf.draw(_FONT, text)


def box(lines: Sequence[str], corner: tuple[float, float], scale: float, color: Color = INK) -> None:
    """Lines of text on a dark ground, its lower left corner at `corner`."""
    (x, y), (width, height) = corner, box_size(lines, scale)
    fill(Rect(x, y, x + width, y + height), GROUND)
    margin, line = 0.5 * _TEXT_PX * scale, text_size("0", scale)[1]
    for index, text in enumerate(lines):
        write(text, x + margin, y + height - margin - (index + 0.7) * line, scale, color)


def box_size(lines: Sequence[str], scale: float) -> tuple[float, float]:
    """Width and height of `box`."""
    sizes = [text_size(text, scale) for text in lines]
    margin = _TEXT_PX * scale
    return max(width for width, _ in sizes) + margin, sum(height for _, height in sizes) + margin
