# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of sockets of a shader tree, by the rules of their nodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import bpy
import numpy as np

from .images import RAMP_TRANSFORM, ImageReader, usable
from .instance_values import asked_by
from .layer_names import DEFAULT_COLOR
from .node_terms import (
    CUT_OUT,
    MISSING,
    REC709,
    WHITE,
    ColorTerm,
    Input,
    NotUnderstoodError,
    NumberTerm,
    Output,
    Rgb,
    TextureUse,
    Transform,
    number,
    rgb,
    source,
)

_LAYER_NODES = ("VERTEX_COLOR", "ATTRIBUTE", "OBJECT_INFO", "PARTICLE_INFO")


@dataclass
class NodeValues:
    """Evaluator of sockets; `notes` collects clauses on what is left out or simplified.

    is_back: of the back side of the surface. asks_side: whether a node asked for the side.
    """

    images: ImageReader
    is_back: bool = False
    notes: list[str] = field(default_factory=list)
    asks_side: bool = False

    def color(self, at: Input) -> ColorTerm:
        """Evaluate a colour input; raises NotUnderstoodError."""
        found = source(at)
        if isinstance(found, Input):
            return ColorTerm(rgb(found.value))
        rule = _COLOR_RULES.get(found.node.type)
        if rule is None:
            raise NotUnderstoodError(f"node '{found.node.name}'")
        return rule(self, found)

    def number(self, at: Input) -> NumberTerm:
        """Evaluate a float input; raises NotUnderstoodError."""
        found = source(at)
        if isinstance(found, Input):
            return NumberTerm(number(found.value))
        rule = _NUMBER_RULES.get(found.node.type)
        if rule is not None:
            return rule(self, found)
        color = self.color(at)  # a colour on a float socket counts by its luminance
        luminance = float(np.dot(color.factor, REC709))
        if color.texture is None:
            return NumberTerm(luminance)
        return NumberTerm(0.0, luminance, color.texture, "Y")

    def constant_number(self, at: Input) -> float:
        """Evaluate a float input that must not vary; raises NotUnderstoodError if it does."""
        term = self.number(at)
        if not term.constant:
            raise NotUnderstoodError("a texture that drives a factor")
        return term.offset

    def constant_color(self, term: ColorTerm) -> Rgb:
        """Mean of the colour over its texture."""
        if term.texture is None:
            return term.factor
        mean = self.images.mean(term.texture)
        r, g, b = (float(one * other) for one, other in zip(term.factor, mean, strict=True))
        return r, g, b


def _texture_use(values: NodeValues, output: Output) -> TextureUse:
    node = output.node
    if not usable(node.image):
        if node.image and node.image.source in ("SEQUENCE", "MOVIE"):
            raise NotUnderstoodError(f"image '{node.image.name}', whose frames are not read")
        raise NotUnderstoodError(f"image '{node.image.name}', which is tiled")
    if node.projection != "FLAT":
        raise NotUnderstoodError(f"the {node.projection.lower()} projection of image '{node.image.name}'")
    closest, straight = node.interpolation == "Closest", node.outputs["Alpha"].is_linked
    return TextureUse(node.image, node.extension, *_uv_transform(output.input("Vector")), closest, straight)


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
    if not getattr(node, "from_instancer", False):
        if node.type == "TEX_COORD" and found.socket.name == "UV":
            return None, ""
        if node.type == "UVMAP":
            return None, node.uv_map
    if node.type == "ATTRIBUTE" and node.attribute_type == "GEOMETRY" and found.socket.name in ("Vector", "Color"):
        return None, node.attribute_name
    raise NotUnderstoodError(f"texture coordinates from node '{node.name}'")


def _mapping_matrix(output: Output) -> np.ndarray:
    """(3, 3) float64 of a Mapping node in the plane of the texture."""
    node = output.node
    names = ("Location", "Rotation", "Scale") if node.vector_type == "POINT" else ("Rotation", "Scale")
    found = [source(output.input(name)) for name in names]
    values = [np.array(rgb(each.value)) for each in found if isinstance(each, Input)]
    if node.vector_type not in ("POINT", "VECTOR") or len(values) < len(names) or abs(values[-2][:2]).max() > 1e-6:
        raise NotUnderstoodError(f"node '{node.name}'")
    *moved, rotation, scale = values
    offset = moved[0] if moved else np.zeros(3)
    cosine, sine = np.cos(rotation[2]), np.sin(rotation[2])
    return np.array(
        [[cosine * scale[0], -sine * scale[1], offset[0]], [sine * scale[0], cosine * scale[1], offset[1]], [0, 0, 1]]
    )


def _is_missing(values: NodeValues, node: bpy.types.Node) -> bool:
    """Return whether an image node has no pixels, and note it; Cycles then shows `MISSING`, opaque."""
    image = node.image
    if usable(image) or (image is not None and image.source in ("SEQUENCE", "MOVIE", "TILED")):
        return False
    name = f"image '{image.name}'" if image else f"node '{node.name}'"
    values.notes.append(f"{name} has no pixels and is pink, as in Cycles")
    return True


def _image_color(values: NodeValues, output: Output) -> ColorTerm:
    if _is_missing(values, output.node):
        return ColorTerm(WHITE if output.socket.name == "Alpha" else MISSING)
    texture = _texture_use(values, output)
    if output.socket.name == "Alpha":
        raise NotUnderstoodError(f"the alpha of image '{texture.name}' as a color")
    return ColorTerm(WHITE, texture)


def _mix_color(values: NodeValues, output: Output) -> ColorTerm:
    node = output.node
    if node.type == "MIX":
        if node.data_type != "RGBA":
            raise NotUnderstoodError(f"node '{node.name}'")
        factor_at, a_at, b_at = _mix_inputs(output, "Color")
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


def _mix_inputs(output: Output, kind: str) -> list[Input]:
    """Factor, A and B of a Mix node for one data type; sockets of all types share names."""
    inputs = {socket.identifier: socket for socket in output.node.inputs}
    return [Input(inputs[name], output.groups) for name in ("Factor_Float", f"A_{kind}", f"B_{kind}")]


def _mean(values: NodeValues, term: ColorTerm) -> Rgb:
    """Mean of a colour; a note names its image."""
    if term.texture is not None:
        values.notes.append(f"image '{term.texture.name}' counts by its mean color")
    return values.constant_color(term)


def _product(values: NodeValues, first: ColorTerm, second: ColorTerm, factor: float) -> ColorTerm:
    """first * lerp(1, second, factor)."""
    if second.texture is not None and first.texture is None and factor >= 1.0:
        first, second = second, first
    r, g, b = (1.0 - factor + factor * each for each in _mean(values, second))
    return first.scaled((r, g, b))


def _blend(values: NodeValues, first: ColorTerm, second: ColorTerm, factor: float) -> ColorTerm:
    """lerp(first, second, factor)."""
    if factor >= 1.0:
        return second
    r, g, b = (a + factor * (b - a) for a, b in zip(_mean(values, first), _mean(values, second), strict=True))
    return ColorTerm((r, g, b))


def _vertex_color(values: NodeValues, output: Output) -> ColorTerm:
    values.notes.append("vertex colors are left out")
    return ColorTerm()


def _ramp(values: NodeValues, output: Output) -> ColorTerm:
    color = output.node.color_ramp.evaluate(values.constant_number(output.input("Fac")))
    return ColorTerm(rgb(color))


def _adjusted(values: NodeValues, output: Output) -> ColorTerm:
    values.notes.append(f"node '{output.node.name}' is left out")
    return values.color(output.input("Color"))


_COLOR_RULES: dict[str, Callable[[NodeValues, Output], ColorTerm]] = {
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


def _layer_number(values: NodeValues, output: Output, channel: str = "") -> NumberTerm:
    """Number from a layer of the mesh, or a value of the object, that a node reads."""
    node, socket = output.node, output.socket
    if asked := asked_by(node, socket.name):
        name = asked.layer
    elif node.type == "VERTEX_COLOR":
        name = node.layer_name or DEFAULT_COLOR
    elif node.type == "ATTRIBUTE" and node.attribute_type == "GEOMETRY":
        name = node.attribute_name
    else:
        raise NotUnderstoodError(f"node '{node.name}'")
    if socket.name == "Alpha" and node.type != "OBJECT_INFO":
        channel = "A" if asked or node.type == "VERTEX_COLOR" else "A1"
    if not name:
        return NumberTerm(float(channel == "A1"))
    channel = channel or ("Y" if socket.type == "RGBA" else "MEAN")
    return NumberTerm(0.0, 1.0, TextureUse(None, "EXTEND", RAMP_TRANSFORM, name), channel)


def _geometry(values: NodeValues, output: Output) -> NumberTerm:
    if output.socket.name != "Backfacing":
        raise NotUnderstoodError(f"node '{output.node.name}'")
    values.asks_side = True
    return NumberTerm(float(values.is_back))


def _image_number(values: NodeValues, output: Output) -> NumberTerm:
    if _is_missing(values, output.node):
        return NumberTerm(1.0 if output.socket.name == "Alpha" else number(MISSING))
    texture = _texture_use(values, output)
    return NumberTerm(0.0, 1.0, texture, "A" if output.socket.name == "Alpha" else "Y")


def _separated(values: NodeValues, output: Output) -> NumberTerm:
    node = output.node
    if getattr(node, "mode", "RGB") != "RGB":
        raise NotUnderstoodError(f"node '{node.name}'")
    channel = list(node.outputs).index(output.socket)
    found = source(output.input(0))
    if isinstance(found, Output) and found.node.type in _LAYER_NODES:
        return _layer_number(values, found, "RGB"[channel])
    color = values.color(output.input(0))
    if color.texture is None:
        return NumberTerm(color.factor[channel])
    return NumberTerm(0.0, color.factor[channel], color.texture, "RGB"[channel])


def _mix_number(values: NodeValues, output: Output) -> NumberTerm:
    if output.node.data_type != "FLOAT":
        raise NotUnderstoodError(f"node '{output.node.name}'")
    factor, a, b = _mix_inputs(output, "Float")
    weight = values.number(factor)
    if weight.constant and weight.offset in (0.0, 1.0):
        return values.number(b if weight.offset else a)
    return values.number(a).mixed(values.number(b), weight)


def _math(values: NodeValues, output: Output) -> NumberTerm:
    node = output.node
    a = values.number(output.input(0))
    if node.operation == "ROUND":
        return _clamped(_step(a, 0.5, above=True), node)
    b = values.number(output.input(1))
    rules: dict[str, Callable[[], NumberTerm]] = {
        "MULTIPLY": lambda: b.affine(a.offset, 0.0) if a.constant else a.affine(_constant(b), 0.0),
        "ADD": lambda: a.plus(b),
        "SUBTRACT": lambda: a.plus(b.affine(-1.0, 0.0)),
        "DIVIDE": lambda: a.affine(1.0 / _constant(b), 0.0),
        "GREATER_THAN": lambda: _compare(a, b, above=True),
        "LESS_THAN": lambda: _compare(a, b, above=False),
    }
    if node.operation not in rules:
        raise NotUnderstoodError(f"node '{node.name}' ({node.operation.lower()})")
    return _clamped(rules[node.operation](), node)


def _clamped(term: NumberTerm, node: bpy.types.Node) -> NumberTerm:
    if node.use_clamp and term.constant:
        return replace(term, offset=min(max(term.offset, 0.0), 1.0))
    return term  # opacity is clamped in the end


def _constant(term: NumberTerm) -> float:
    if not term.constant:
        raise NotUnderstoodError("arithmetic of two textures")
    return term.offset


def _compare(a: NumberTerm, b: NumberTerm, above: bool) -> NumberTerm:
    if b.constant:
        return _step(a, b.offset, above)
    return _step(b, _constant(a), not above)


def _step(term: NumberTerm, threshold: float, above: bool) -> NumberTerm:
    """1 where the term is at least the threshold (`above`) or below it, else 0."""
    if term.threshold is not None:
        low, high = (float((level >= threshold) == above) for level in term.levels)
        return replace(term, levels=CUT_OUT).affine(high - low, low)
    if term.constant:
        return NumberTerm(float((term.offset >= threshold) == above))
    if above:
        return replace(term, threshold=threshold)
    return replace(term.affine(-1.0, 1.0), threshold=1.0 - threshold)


_NUMBER_RULES: dict[str, Callable[[NodeValues, Output], NumberTerm]] = {
    "TEX_IMAGE": _image_number,
    "VALUE": lambda values, output: NumberTerm(float(output.socket.default_value)),
    "MATH": _math,
    "MIX": _mix_number,
    "SEPARATE_COLOR": _separated,
    "SEPRGB": _separated,
    **dict.fromkeys(_LAYER_NODES, _layer_number),
    "NEW_GEOMETRY": _geometry,
    "LIGHT_PATH": lambda values, output: NumberTerm(float(output.socket.name == "Is Camera Ray")),
}
