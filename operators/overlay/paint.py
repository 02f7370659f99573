# SPDX-License-Identifier: GPL-3.0-or-later
"""Rectangles, ramps, textures and text in the pixels of a region, in sRGB colours as Blender's own text."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from ..session.shown_view import ShownView
from .layout import Rect

_MAX = 6  # two sides of a wipe in three editors
_textures: OrderedDict[tuple[Any, ...], Any] = OrderedDict()


def texture_of(view: ShownView, name: str, maximum: float, ramp: str) -> Any:
    """Texture (gpu.types.GPUTexture) of a view's picture, made when it is first drawn."""
    key = (view.number, name, *((maximum, ramp) if name not in view.looks else ()))
    if key not in _textures:
        _textures[key] = uploaded(view.picture(name, maximum, ramp))
        while len(_textures) > _MAX:
            _textures.popitem(last=False)
    _textures.move_to_end(key)
    return _textures[key]


def free_textures() -> None:
    """Give the graphics card its memory back."""
    _textures.clear()


def held() -> int:
    """Number of textures that are held."""
    return len(_textures)


def texels(picture: np.ndarray) -> np.ndarray:
    """Texels (H, W, 4) float32 of sRGB colours (H, W, 3), opaque, or with straight alpha (H, W, 4)."""
    opaque = np.ones((*picture.shape[:2], 4 - picture.shape[-1]), np.float32)  # no column where there is alpha
    return np.concatenate([picture, opaque], axis=-1, dtype=np.float32)


def uploaded(picture: np.ndarray) -> Any:
    """Upload sRGB colours as a texture, see `texels`."""
    import gpu

    height, width = picture.shape[:2]
    pixels = texels(picture)
    data = gpu.types.Buffer("FLOAT", pixels.size, pixels.ravel())
    return gpu.types.GPUTexture((width, height), format="RGBA8", data=data)


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


def fill(rect: Rect, color: Color) -> None:
    """Draw a rectangle of one colour."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    batch = batch_for_shader(shader, "TRI_STRIP", {"pos": _corners(rect)})
    gpu.state.blend_set("ALPHA")
    shader.bind()
    shader.uniform_float("color", color)
    batch.draw(shader)
    gpu.state.blend_set("NONE")


def ramp(rect: Rect, colors: np.ndarray) -> None:
    """Draw a bar of colours (N, 3) from left to right."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    places = np.linspace(rect.left, rect.right, len(colors))
    points = [(float(x), y, 0.0) for x in places for y in (rect.bottom, rect.top)]
    shades = [(*color.tolist(), 1.0) for color in colors for _ in range(2)]
    batch = batch_for_shader(shader, "TRI_STRIP", {"pos": points, "color": shades})
    gpu.state.blend_set("ALPHA")
    shader.bind()
    batch.draw(shader)
    gpu.state.blend_set("NONE")


def picture(texture: Any, whole: Rect, seen: Rect, opacity: float) -> None:
    """Draw the part `seen` of a texture that covers `whole`; where it is magnified, its pixels are squares."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    if seen.empty:
        return
    left, right = ((x - whole.left) / whole.width for x in (seen.left, seen.right))
    bottom, top = ((y - whole.bottom) / whole.height for y in (seen.bottom, seen.top))
    shader = _picture_shader()
    corners = [(left, bottom), (right, bottom), (left, top), (right, top)]
    points = [point[:2] for point in _corners(seen)]
    batch = batch_for_shader(shader, "TRI_STRIP", {"pos": points, "place": corners})
    gpu.state.blend_set("ALPHA")
    shader.bind()
    shader.uniform_float("matrix", gpu.matrix.get_projection_matrix() @ gpu.matrix.get_model_view_matrix())
    shader.uniform_sampler("image", texture)
    shader.uniform_float("opacity", opacity)
    batch.draw(shader)
    gpu.state.blend_set("NONE")


@cache
def _picture_shader() -> Any:
    """Shader for pictures: Blender's own one for images blurs them; before Blender 5 no texture could change that."""
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


def free_shader() -> None:
    """Forget the shader that pictures are drawn with."""
    _picture_shader.cache_clear()


def text_size(text: str, scale: float) -> tuple[float, float]:
    """Width and line height of a text in pixels; scale: of the user's display."""
    import blf

    blf.size(_FONT, _TEXT_PX * scale)
    return blf.dimensions(_FONT, text)[0], _TEXT_PX * scale * 1.35


def write(text: str, x: float, y: float, scale: float, color: Color = INK) -> None:
    """Draw a line of text with the foot of its letters at y."""
    import blf

    blf.size(_FONT, _TEXT_PX * scale)
    blf.color(_FONT, *color)
    blf.position(_FONT, x, y, 0.0)
    blf.draw(_FONT, text)


def box(lines: Sequence[tuple[str, Color]], corner: tuple[float, float], scale: float) -> None:
    """Lines of text on a dark ground, its lower left corner at `corner`."""
    width, height = box_size([text for text, _ in lines], scale)
    margin = 0.5 * _TEXT_PX * scale
    fill(Rect(corner[0], corner[1], corner[0] + width, corner[1] + height), GROUND)
    line = text_size("0", scale)[1]
    for index, (text, color) in enumerate(lines):
        y = corner[1] + height - margin - (index + 1) * line + 0.3 * line
        write(text, corner[0] + margin, y, scale, color)


def box_size(texts: Sequence[str], scale: float) -> tuple[float, float]:
    """Width and height of `box`."""
    sizes = [text_size(text, scale) for text in texts]
    margin = _TEXT_PX * scale
    return max(width for width, _ in sizes) + margin, sum(height for _, height in sizes) + margin


def _corners(rect: Rect) -> list[tuple[float, float, float]]:
    return [(x, y, 0.0) for y in (rect.bottom, rect.top) for x in (rect.left, rect.right)]
