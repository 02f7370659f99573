# SPDX-License-Identifier: GPL-3.0-or-later
"""Shader nodes that yield colours, each with the rule that evaluates it."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np

from .images import usable
from .node_links import Input, Output, source
from .node_terms import MISSING, WHITE, ColorTerm, NodeEvaluator, NotUnderstoodError, TextureUse, Transform, rgb


def texture_use(values: NodeEvaluator, output: Output) -> TextureUse:
    node = output.node
    if not usable(node.image):
        if node.image and node.image.source in ("SEQUENCE", "MOVIE"):
            raise NotUnderstoodError(f"image '{node.image.name}', whose frames are not read")
        raise NotUnderstoodError(f"image '{node.image.name}', which is tiled")
    if node.projection != "FLAT":
        raise NotUnderstoodError(f"the {node.projection.lower()} projection of image '{node.image.name}'")
    closest = node.interpolation == "Closest"
    return TextureUse(node.image, node.extension, *_uv_transform(output.input("Vector")), closest)


def _uv_transform(at: Input) -> tuple[Transform | None, str]:
    """Transform from a UV map to texture coordinates, None for the map itself, and the map's name."""
    found = source(at)
    if isinstance(found, Input):
        return None, ""
    node = found.node
    if node.type == "MAPPING":
        inner, uv_map = _uv_transform(found.input("Vector"))
        matrix = _mapping_matrix(found)
        if inner is not None:
            matrix = matrix @ np.vstack([inner, [0, 0, 1]])
        (a, b, c), (d, e, f) = matrix[:2]
        return ((float(a), float(b), float(c)), (float(d), float(e), float(f))), uv_map
    if _repeats_along_one_axis(found):
        raise NotUnderstoodError(f"an image that repeats along one axis alone (node '{node.name}')")
    if not getattr(node, "from_instancer", False):
        if node.type == "TEX_COORD" and found.socket.name == "UV":
            return None, ""
        if node.type == "UVMAP":
            return None, node.uv_map
    if node.type == "ATTRIBUTE" and node.attribute_type == "GEOMETRY" and found.socket.name in ("Vector", "Color"):
        return None, node.attribute_name
    raise NotUnderstoodError(f"texture coordinates from node '{node.name}'")


def _repeats_along_one_axis(output: Output) -> bool:
    """Return whether the coordinates are those that importers of glTF make, where wrap modes of the axes differ."""
    if output.node.type != "COMBXYZ":
        return False
    axes = [source(output.input(name)) for name in ("X", "Y")]
    return any(
        isinstance(axis, Output) and axis.node.type == "MATH" and axis.node.operation in ("WRAP", "PINGPONG")
        for axis in axes
    )


def _mapping_matrix(output: Output) -> np.ndarray:
    """(3, 3) float64 of a Mapping node in the plane of the texture."""
    node = output.node
    offset, rotation, scale = (
        np.array(rgb(found.value)) if isinstance(found := source(output.input(name)), Input) else None
        for name in ("Location", "Rotation", "Scale")
    ) if node.vector_type in ("POINT", "VECTOR") else (None, None, None)  # fmt: skip
    if node.vector_type == "VECTOR":
        offset = np.zeros(3)
    if offset is None or rotation is None or scale is None or abs(rotation[:2]).max() > 1e-6:
        raise NotUnderstoodError(f"node '{node.name}'")
    cosine, sine = np.cos(rotation[2]), np.sin(rotation[2])
    return np.array(
        [[cosine * scale[0], -sine * scale[1], offset[0]], [sine * scale[0], cosine * scale[1], offset[1]], [0, 0, 1]]
    )


def is_missing(values: NodeEvaluator, node: bpy.types.Node) -> bool:
    """Return whether an image node has no image to show: Cycles then shows `MISSING`, opaque. A note says so."""
    image = node.image
    if usable(image) or (image is not None and image.source in ("SEQUENCE", "MOVIE", "TILED")):
        return False
    name = f"image '{image.name}'" if image else f"node '{node.name}'"
    values.notes.append(f"{name} has no pixels, and is pink as in Cycles")
    return True


def _image_color(values: NodeEvaluator, output: Output) -> ColorTerm:
    if is_missing(values, output.node):
        return ColorTerm(WHITE if output.socket.name == "Alpha" else MISSING)
    texture = texture_use(values, output)
    if output.socket.name == "Alpha":
        raise NotUnderstoodError(f"the alpha of image '{texture.image.name}' as a color")
    return ColorTerm(WHITE, texture)


def _mix_color(values: NodeEvaluator, output: Output) -> ColorTerm:
    node = output.node
    if node.type == "MIX":
        if node.data_type != "RGBA":
            raise NotUnderstoodError(f"node '{node.name}'")
        # Sockets of all data types share names; these are the ones of colours.
        factor, a, b = ("Factor_Float", "A_Color", "B_Color")
        factor_at, a_at, b_at = (
            Input(next(s for s in node.inputs if s.identifier == name), output.groups) for name in (factor, a, b)
        )
    else:
        factor_at, a_at, b_at = (output.input(index) for index in range(3))
    factor_value = values.constant_number(factor_at)
    if node.blend_type not in ("MIX", "MULTIPLY"):
        raise NotUnderstoodError(f"blend mode {node.blend_type.lower()} of node '{node.name}'")
    if factor_value <= 0.0:
        return values.color(a_at)
    first, second = values.color(a_at), values.color(b_at)
    if node.blend_type == "MULTIPLY":
        return _product(values, first, second, factor_value)
    return _blend(values, first, second, factor_value)


def _product(values: NodeEvaluator, first: ColorTerm, second: ColorTerm, factor: float) -> ColorTerm:
    """first * lerp(1, second, factor)."""
    if second.texture is not None and first.texture is None and factor >= 1.0:
        first, second = second, first
    if second.texture is not None:
        values.notes.append(f"image '{second.texture.image.name}' counts by its mean color")
    r, g, b = (1.0 - factor + factor * each for each in values.constant_color(second))
    return first.scaled((r, g, b))


def _blend(values: NodeEvaluator, first: ColorTerm, second: ColorTerm, factor: float) -> ColorTerm:
    """lerp(first, second, factor)."""
    if factor >= 1.0:
        return second
    for term in (first, second):
        if term.texture is not None:
            values.notes.append(f"image '{term.texture.image.name}' counts by its mean color")
    pairs = zip(values.constant_color(first), values.constant_color(second), strict=True)
    r, g, b = (a + factor * (b - a) for a, b in pairs)
    return ColorTerm((r, g, b))


def _vertex_color(values: NodeEvaluator, output: Output) -> ColorTerm:
    values.notes.append("vertex colors are left out")
    return ColorTerm()


def _ramp(values: NodeEvaluator, output: Output) -> ColorTerm:
    color = output.node.color_ramp.evaluate(values.constant_number(output.input("Fac")))
    return ColorTerm(rgb(color))


def _adjusted(values: NodeEvaluator, output: Output) -> ColorTerm:
    values.notes.append(f"node '{output.node.name}' is left out")
    return values.color(output.input("Color"))


COLOR_RULES: dict[str, Callable[[NodeEvaluator, Output], ColorTerm]] = {
    "TEX_IMAGE": _image_color,
    "RGB": lambda values, output: ColorTerm(rgb(output.socket.default_value)),
    "VALUE": lambda values, output: ColorTerm(rgb(output.socket.default_value)),
    "MIX": _mix_color,
    "MIX_RGB": _mix_color,
    "VALTORGB": _ramp,
    "VERTEX_COLOR": _vertex_color,
    "ATTRIBUTE": _vertex_color,
    "GAMMA": _adjusted,
    "BRIGHTCONTRAST": _adjusted,
    "HUE_SAT": _adjusted,
    "CURVE_RGB": _adjusted,
}
